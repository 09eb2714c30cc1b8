"""The paper's tree beside ours: the part of Ikeuchi 1987 compiled under both policies, and why they decide as they do.

    python experiments/paper_tree.py [--draws N] [--sensor SENSOR] [--out DIR]

Prints two tables: every decision of the paper beside those of the policies `paper` and `measured` with the measured
errors, and both policies on fresh simulated regions with the expected error of the whole tree. Wherever the tree under
policy `paper` differs from the paper, the errors that forbid the paper's rule are printed and drawn
(`differences.png`): how far the draws' attitudes are from the truth after each rule, or how far the margin of a
classification rule is on the right side.
"""

import argparse
import json
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from itree_cad.bundled import ikeuchi_part
from itree_kernels.mesh import ray_mesh

from itree_jax.compile import compile_tree
from itree_jax.sensing.sensor_file import load_sensor
from itree_jax.tree.appearance_rows import DeterminationScales
from itree_jax.tree.choice import ERROR_BOUND, measure_rules
from itree_jax.tree.classification_rules import rules_in
from itree_jax.tree.confusion import counted
from itree_jax.tree.determination import REACH, appearance_arrays, in_batches, rule_errors, rules_used, symmetry_arrays
from itree_jax.tree.draws import draw_regions
from itree_jax.tree.error_rates import whole_and_cut
from itree_jax.tree.tree import PRUNED, InterpretationTree
from itree_jax.tree.work_models import group_models

matplotlib.use("Agg")
# Sections 2.1.5 and 2.2.2-2.2.6; labels are those of figure 2f.
BRANCHES = {"B0": "L1", "B1": "L1", "B2": PRUNED, "B3": PRUNED, "B4": "L6", "B5": "L7"}
JOINED = {"B1": "B0"}
CHAINS = {
    "11100000": ("A1", "A4", "A5"), "11000000": ("A1", "A3", "A7"), "11000010": ("A1", "A4", "A7"),
    "11000001": ("A1", "A4", "A7"), "00001100": ("A1", "A3", "A7"),
}  # fmt: skip
NAMES = {"11100000": "S1", "11000000": "S2", "11000010": "S3", "11000001": "S4", "00001100": "S5"}


@dataclass(frozen=True)
class Config:
    sensor: str = "bundled:ikeuchi-1987"
    draws: int = 400  # per group: half of them stand alone, which is what policy `paper` goes by
    fresh: int = 200  # per group, for the second table
    seed: int = 0
    out: Path = Path("out/paper_tree")


def main(config: Config) -> None:
    config.out.mkdir(parents=True, exist_ok=True)
    part, sensor = ikeuchi_part(), load_sensor(config.sensor)
    trees = {
        policy: compile_tree(part, sensor, policy=policy, draws=config.draws, seed=config.seed)
        for policy in ("paper", "measured")
    }
    decisions = decision_rows(trees)
    policies = policy_rows(trees, config)
    report = {"config": asdict(config) | {"out": str(config.out)}, "decisions": decisions, "policies": policies}
    (config.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    table = decision_table(decisions) + "\n" + policy_table(policies)
    (config.out / "table.md").write_text(table)
    print(table)
    draw_differences(trees["paper"], decisions, config)


def decision_rows(trees: dict[str, InterpretationTree]) -> list[dict[str, Any]]:
    """Every decision of the paper, ours under both policies, and the measured errors of the rules that they name."""
    tree = trees["paper"]
    rows = []
    for branch, rule in BRANCHES.items():
        wanted = joined_name(rule, JOINED.get(branch))
        found = {f"{policy}_tree": at_branch(t, branch) for policy, t in trees.items()}
        k = tree.nodes.branch.index(branch)
        rows.append({
            "where": branch, "paper": wanted, **found, "same": found["paper_tree"] == wanted,
            "errors": {
                r: {"whole": float(e[0]), "cut": float(e[1])}
                for r, e in zip(tree.distributions.rules, tree.nodes.rule_errors[k], strict=True)
            },
        })  # fmt: skip
    for label, chain in CHAINS.items():
        g = tree.groups.label_strings.index(label)
        d = tree.determination
        found = {f"{policy}_tree": " ".join(t.determination.steps[g]) or "-" for policy, t in trees.items()}
        rows.append({
            "where": NAMES[label], "label": label, "paper": " ".join(chain), **found,
            "same": found["paper_tree"] == " ".join(chain),
            "errors": {r: {"whole": float(e)} for r, e in zip(d.rules, d.error[g], strict=True)},
            "intervals": {r: i.tolist() for r, i in zip(d.rules, d.error_interval[g], strict=True)},
        })  # fmt: skip
    return [{**row, "why": why(row)} for row in rows]


def at_branch(tree: InterpretationTree, branch: str) -> str:
    k = tree.nodes.branch.index(branch)
    top = int(tree.nodes.joined[k])
    return joined_name(tree.nodes.rule[k], tree.nodes.branch[top] if top != k else None)


def joined_name(rule: str, top: str | None) -> str:
    return rule if top is None else f"{rule}, joined to {top}"


def why(row: dict[str, Any]) -> str:
    """The errors that forbid the paper's rules, and those of earlier rules which suffice."""
    if row["same"]:
        return ""
    wanted, got = (row[key].split(", ")[0].split() for key in ("paper", "paper_tree"))
    errors = {rule: error["whole"] for rule, error in row["errors"].items()}
    over = [f"{r} errs in {100 * errors[r]:.1f} %" for r in wanted if r in errors and errors[r] >= ERROR_BOUND]
    instead = [f"{r} comes first and errs in {100 * errors[r]:.1f} %" for r in got if r in errors and r not in wanted]
    return "; ".join([*over, *instead])


def policy_rows(trees: dict[str, InterpretationTree], config: Config) -> list[dict[str, Any]]:
    """Both policies on the same fresh draws: the error of every branch and of the whole tree."""
    rows = []
    for policy, tree in trees.items():
        part, groups = tree.part, tree.groups
        mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
        fresh = draw_regions(mesh, tree.sensor, groups, config.fresh, np.random.default_rng([config.seed, 7]))
        kept, prior = ~groups.pruned, np.where(groups.pruned, 0.0, groups.view_count)
        prior = prior / prior.sum()
        told = measure_rules(fresh, group_models(tree.appearances, groups.group_count), tree.distributions, prior)
        for k, branch in enumerate(tree.nodes.branch):
            if tree.nodes.rule[k] == PRUNED:
                continue
            sides = tree.nodes.visible[k] & kept, tree.nodes.hidden[k] & kept
            at = told.take(np.flatnonzero((sides[0] | sides[1])[told.group]))
            whole, cut = whole_and_cut(at, rules_in(tree.nodes.rule[k]), prior, *sides)
            rows.append({
                "policy": policy, "where": branch, "rule": tree.nodes.rule[k], "draws": len(at.group),
                "fresh": {"whole": float(whole), "cut": float(cut), "both": float(whole + cut) / 2},
                "measured": kinds(tree.nodes.whole_and_cut[k]),
            })  # fmt: skip
        walked = counted(tree, config.fresh, config.seed + 1)
        rows.append({
            "policy": policy, "where": "whole tree", "rule": "", "draws": int(walked.draws.sum()),
            "fresh": kinds(walked.error), "measured": kinds(tree.confusion.expected_error),
            "interval": walked.interval.tolist(),
        })  # fmt: skip
    return rows


def kinds(errors: np.ndarray) -> dict[str, float]:
    return {"whole": float(errors[0]), "cut": float(errors[1]), "both": float(np.mean(errors))}


def decision_table(rows: list[dict[str, Any]]) -> str:
    lines = ["| | the paper | policy `paper` | policy `measured` | why `paper` differs |", "|---|---|---|---|---|"]
    for row in rows:
        cells = (row[key] for key in ("where", "paper", "paper_tree", "measured_tree", "why"))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def policy_table(rows: list[dict[str, Any]]) -> str:
    heads = ["policy", "node", "rule", "error expected, whole / cut / both", "on fresh draws", "draws"]
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for row in rows:
        said, found = (
            " / ".join(f"{100 * row[key][kind]:.1f} %" for kind in ("whole", "cut", "both"))
            for key in ("measured", "fresh")
        )
        lines.append(f"| {row['policy']} | {row['where']} | {row['rule']} | {said} | {found} | {row['draws']} |")
    return "\n".join(lines) + "\n"


def draw_differences(tree: InterpretationTree, rows: list[dict[str, Any]], config: Config) -> None:
    """One panel for every determination chain that differs: what each rule leaves, as cumulated shares of draws."""
    differing = [row for row in rows if not row["same"] and "label" in row]
    if not differing:
        return
    errors, group = attitude_errors(tree, config)
    figure, axes = plt.subplots(1, len(differing), figsize=(4.2 * len(differing), 3.6), sharey=True, squeeze=False)
    for axis, row in zip(axes[0], differing, strict=True):
        g = tree.groups.label_strings.index(row["label"])
        for k, rule in enumerate(tree.determination.rules):
            left = np.sort(np.degrees(errors[group == g, k]))
            used = rule in row["paper"].split()
            axis.plot(left, np.arange(1, len(left) + 1) / len(left), lw=2.0 if used else 0.8, label=rule)
        axis.axvline(np.degrees(REACH), color="black", lw=0.8, ls="--")
        axis.axhline(1.0 - ERROR_BOUND, color="black", lw=0.8, ls=":")
        axis.set_title(f"{row['where']}: paper {row['paper']}, here {row['paper_tree']}", fontsize=9)
        axis.set_xlabel("attitude error left [degrees]")
    axes[0, 0].set_ylabel("share of draws (whole regions)")
    axes[0, -1].legend(fontsize=8, ncol=2)
    figure.tight_layout()
    figure.savefig(config.out / "differences.png", dpi=130)
    plt.close(figure)


def attitude_errors(tree: InterpretationTree, config: Config) -> tuple[np.ndarray, np.ndarray]:
    """What A1..A8 leave of the draws that the error rates were measured on [rad], and the draws' groups."""
    part, groups = tree.part, tree.groups
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle)
    draws = draw_regions(mesh, tree.sensor, groups, config.draws, np.random.default_rng([config.seed, 2]))
    draws = draws.take(np.flatnonzero(~draws.cut))
    rows = appearance_arrays(tree.appearances, rules_used(tree.determination.steps))
    scales = DeterminationScales(*map(jnp.float32, tree.determination.scales))
    measure = partial(rule_errors, roll_step=2.0 * np.pi / tree.rolls)
    return in_batches(measure, draws, rows, scales, *symmetry_arrays(tree.symmetries)), draws.group


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sensor", default=Config.sensor)
    parser.add_argument("--draws", type=int, default=Config.draws)
    parser.add_argument("--fresh", type=int, default=Config.fresh)
    parser.add_argument("--seed", type=int, default=Config.seed)
    parser.add_argument("--out", type=Path, default=Config.out)
    main(Config(**vars(parser.parse_args())))
