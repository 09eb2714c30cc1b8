"""Fits the probability of an answer on the validation bins, and prints how well it holds: the table behind the scores.

    python experiments/validation_bins.py --out out/validation_bins
    python experiments/calibrate_scores.py [--bins DIR ...] [--depth file|stereo|none] [--out DIR] [--trees DIR]
        [--every N] [--refinement NATS]

Every scene is recognised; all poses that no better one excludes are kept, however improbable, with their measures
(`refinement.scoring.Measures`) and whether they are right (MSSD under 5 % of the diameter). A logistic model, with the
signs that doubt must have, is fitted to them. Its table comes from models that were each fitted without the part that
they are held against (of several folders of bins parts are told apart by their object numbers). A last table says
whether new weights are worth it: fitted to the scenes of odd number, beside those in force, both on the scenes of even
number. Rows of an earlier run in --out, in a folder named as that of the bins, are kept: only scenes that lack are
recognised.
"""

import argparse
import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from evaluate_scenes import Config as Evaluation
from evaluate_scenes import scenes_of_parts, tree_of
from jaxtyping import Bool, Float, Int
from quality.comparison import markdown_table
from quality.reliability_tables import reliability_report
from scipy.optimize import minimize
from scipy.special import expit

from itree_jax.cli.scene_answer import load_with_trees, with_depth_from
from itree_jax.competition import selections
from itree_jax.evaluation.judged import ScoredAnswers
from itree_jax.evaluation.matching import match
from itree_jax.evaluation.pose_errors import Pose, mssd
from itree_jax.evaluation.score import STRICT, VISIBLE
from itree_jax.evaluation.truth import Model, SceneTruth, load_models, load_truth
from itree_jax.prepared import Prepared, prepare, prepare_forest
from itree_jax.recognition import read_scene
from itree_jax.refinement.scoring import SCORINGS, SIGNS, Scoring, share, terms
from itree_jax.tree.tree_file import load_tree

RIDGE = 3e-3  # on standardised weights: some hundreds of answers for ten terms
LEAST_SPREAD = 0.1  # of a term: what hardly changes from answer to answer gets no large weight
SUREST = 1.0 - 1e-6  # share that still lets an answer be wrong
FROM = (0.5, 0.65, 0.8, 0.9)  # scores from which on two models are compared
PRECISION = 0.99  # of the answers together, on bins of our own renderer: others are less alike


@dataclass(frozen=True)
class Config:
    bins: tuple[Path, ...] = (Path("out/validation_bins"),)
    depth: str = "file"
    out: Path = Path("out/calibrate_scores")
    trees: Path | None = None  # folder of trees of an earlier run
    refinement: float | None = None  # [nats] as in `Scoring`; None: as in force
    every: int = 1  # takes every n-th scene of each part


class Rows(NamedTuple):
    """The answers of one scene, however improbable, and its instances."""

    scene_id: int
    part: int
    terms: Float[np.ndarray, "answers terms"]
    margin: Float[np.ndarray, "answers"]  # [nats] over the best rival
    error: Float[np.ndarray, "answers instances"]  # MSSD over the diameter
    visible: Float[np.ndarray, "instances"]


def main(config: Config) -> None:
    """Prints the fitted model and its tables."""
    rows = rows_of(config)
    part = np.concatenate([np.full(len(r.terms), r.part) for r in rows])
    in_force = SCORINGS[kind_of(config.depth)]
    refinement = config.refinement or in_force.refinement
    X, margins, right = poses_of(rows)
    held_out = np.zeros(len(right))
    for one in np.unique(part):
        model = fitted(X[part != one], margins[part != one], right[part != one], refinement)
        held_out[part == one] = of_terms(X[part == one], margins[part == one], model)
    answers = scored(rows, held_out)
    print(reliability_report(answers))
    least = least_probability(answers)
    model = fitted(X, margins, right, refinement)._replace(least=least)
    weights = ", ".join(f"{w:.3f}" for w in model.weights)
    print(f"{len(right)} poses of {len(rows)} scenes, {right.mean():.0%} right. Terms: {', '.join(SIGNS)}")
    print(f"Brier score of the held out {np.mean((held_out - right) ** 2):.4f}, ratios under {refinement:.0f} nats are "
          "no evidence")
    print(both_models(rows, in_force, refinement))
    print(f'"{kind_of(config.depth)}": Scoring(({weights}), {model.bias:.3f}, {least:.2f}, {refinement:.1f}),')


def kind_of(depth: str) -> str:
    return "depth" if depth == "file" else depth


def rows_of(config: Config) -> list[Rows]:
    """The rows of all folders of bins."""
    names = [bins.name for bins in config.bins]
    if len(set(names)) < len(names):
        raise SystemExit(f"rows are kept by the folder's name, and two of these are named alike: {', '.join(names)}")
    return [row for bins in config.bins for row in rows_of_bins(bins, config)]


def rows_of_bins(bins: Path, config: Config) -> list[Rows]:
    """The rows of every scene of one folder of bins, those of an earlier run read from `config.out`."""
    models = load_models(bins)
    truths = {t.scene_id: t for t in load_truth(bins)}
    found, out = [], config.out / bins.name
    out.mkdir(parents=True, exist_ok=True)
    evaluation = Evaluation(dataset=bins, out=out, depth=config.depth, trees=config.trees)
    for obj_id, folders in scenes_of_parts(bins):
        prepared: dict[int, Prepared] = {}
        for folder in folders[:: config.every]:
            kept = out / f"{folder.name}_{config.depth}.pkl"
            if not kept.is_file():
                lights = len(list((folder / "lit").glob("000000_*")))
                if lights not in prepared:
                    prepared[lights] = prepare(load_tree(tree_of(evaluation, obj_id, lights, folder)))
                truth = truths[int(folder.name)]
                rows = rows_of_scene(folder, prepared[lights], config.depth, obj_id, truth, models[obj_id])
                kept.write_bytes(pickle.dumps(tuple(rows)[1:]))
                print(folder.name, len(rows.terms), flush=True)
            found.append(Rows(int(folder.name), *pickle.loads(kept.read_bytes())))
    return found


def rows_of_scene(folder: Path, prepared: Prepared, depth: str, obj_id: int, truth: SceneTruth, model: Model) -> Rows:
    """Recognises one scene and keeps all poses that don't exclude one another."""
    scene, _ = load_with_trees(folder, [prepared])
    scene, second = with_depth_from(depth, scene, prepared.tree.sensor)
    forest = prepare_forest([prepared])
    answers, sight = read_scene(forest, scene.images, scene.sensor, scene.depth, scene.R_w2c, second)
    open_ = SCORINGS[sight.kind]._replace(least=0.0)
    X, margins, R, t = [np.zeros((0, len(SIGNS)))], [np.zeros(0)], [np.zeros((0, 3, 3))], [np.zeros((0, 3))]
    for answer, selection in zip(answers, selections(answers, sight, open_) if answers else [], strict=True):
        poses = prepared.of_object(answer.hypotheses.poses)
        X.append(terms(selection.measures))
        margins.append(selection.measures.margin)
        R.append(np.asarray(poses.R_cam_obj, float)[selection.accepted])
        t.append(np.asarray(poses.t_cam_obj, float)[selection.accepted])
    found = Pose(np.concatenate(R)[:, None], np.concatenate(t)[:, None])
    true = Pose(truth.pose.R[None], truth.pose.t[None])
    error = mssd(found, true, model.hull, model.symmetries) / model.diameter
    return Rows(truth.scene_id, obj_id, np.concatenate(X), np.concatenate(margins), error, truth.visible)


def poses_of(
    rows: Sequence[Rows],
) -> tuple[Float[np.ndarray, "answers terms"], Float[np.ndarray, "answers"], Bool[np.ndarray, "answers"]]:
    """The terms and margins of all answers, and which are right."""
    right = np.concatenate([r.error.min(axis=1, initial=np.inf) < STRICT for r in rows])
    return np.concatenate([r.terms for r in rows]), np.concatenate([r.margin for r in rows]), right


def both_models(rows: Sequence[Rows], in_force: Scoring, refinement: float) -> str:
    """The weights in force beside those fitted to the scenes of odd number, held against the scenes of even number."""
    odd, even = ([r for r in rows if r.scene_id % 2 == rest] for rest in (1, 0))
    if not odd or not even:
        return "Weights in force and fitted ones are compared where there are scenes of odd and of even number."
    models = {"in force": in_force, "fitted to odd scenes": fitted(*poses_of(odd), refinement)}
    lines = [[name, *held_against(even, model)] for name, model in models.items()]
    heads = ["weights", "scenes", "poses", "Brier score", *(f"precision, recall from {p:.2f}" for p in FROM)]
    return markdown_table(heads, lines)


def held_against(rows: Sequence[Rows], model: Scoring) -> list[str]:
    """Of one model: how many scenes and poses, the Brier score, precision and recall from some scores on."""
    X, margins, right = poses_of(rows)
    score = of_terms(X, margins, model)
    answers = scored(rows, score)
    cells = []
    for least in FROM:
        taken = answers.score >= least
        found = f"{answers.found_visible[taken].sum() / max(answers.visible, 1):.0%}"
        cells.append(f"{answers.right[taken].mean():.0%}, {found}" if taken.any() else "-, 0%")
    return [str(len(rows)), str(len(right)), f"{np.mean((score - right) ** 2):.4f}", *cells]


def fitted(
    X: Float[np.ndarray, "answers terms"], margins: Float[np.ndarray, "answers"], right: Bool[np.ndarray, "answers"],
    refinement: float,
) -> Scoring:
    """The model of greatest likelihood whose weights have the signs that they must have: an answer is right with the
    probability of a logistic model of the terms times its share.
    """
    scale = np.maximum(X.std(axis=0), LEAST_SPREAD)
    Z, kept = X / scale, np.minimum(share(margins, refinement), SUREST)

    def loss(w: Float[np.ndarray, "weights"]) -> tuple[float, Float[np.ndarray, "weights"]]:
        place = expit(Z @ w[:-1] + w[-1])
        p = place * kept
        cost = -np.where(right, np.log(np.maximum(p, 1e-12)), np.log1p(-p))
        slope = np.where(right, place - 1.0, p * (1.0 - place) / (1.0 - p)) / len(right)
        gradient = np.append(slope @ Z + 2.0 * RIDGE * w[:-1], slope.sum())
        return float(cost.mean() + RIDGE * np.sum(w[:-1] ** 2)), gradient

    bounds = [(0.0, None) if sign > 0 else (None, 0.0) for sign in SIGNS.values()] + [(None, None)]
    w = minimize(loss, np.zeros(Z.shape[1] + 1), jac=True, bounds=bounds, method="L-BFGS-B").x
    return Scoring(tuple(float(v) for v in w[:-1] / scale), float(w[-1]), 0.0, refinement)


def of_terms(
    X: Float[np.ndarray, "answers terms"], margins: Float[np.ndarray, "answers"], model: Scoring
) -> Float[np.ndarray, "answers"]:
    """Probability of being right."""
    return expit(X @ np.array(model.weights) + model.bias) * share(margins, model.refinement)


def scored(rows: Sequence[Rows], score: Float[np.ndarray, "answers"]) -> ScoredAnswers:
    """Answers find their instances by falling score, as in `evaluate`."""
    of_scene = np.split(score, np.cumsum([len(r.terms) for r in rows])[:-1])
    found: list[Int[np.ndarray, answers]] = [match(r.error, s, STRICT) for r, s in zip(rows, of_scene, strict=True)]
    visible = [np.append(r.visible >= VISIBLE, False) for r in rows]
    return ScoredAnswers(
        score, np.concatenate([f >= 0 for f in found]),
        np.concatenate([v[f] for v, f in zip(visible, found, strict=True)]), int(sum(v.sum() for v in visible)),
    )  # fmt: skip


def least_probability(answers: ScoredAnswers) -> float:
    """The lowest probability from which on answers are as precise together as they should be."""
    for least in np.arange(0.05, 0.96, 0.05):
        taken = answers.score >= least
        if taken.any() and answers.right[taken].mean() >= PRECISION:
            return float(least)
    return 0.95


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bins", type=Path, nargs="+", default=Config.bins)
    parser.add_argument("--depth", choices=("file", "stereo", "none"), default=Config.depth)
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--trees", type=Path, default=None)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--refinement", type=float, default=None)
    given = vars(parser.parse_args())
    main(Config(**given | {"bins": tuple(given["bins"])}))
