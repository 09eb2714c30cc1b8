"""How well bins were recognised: reliability of the scores, confusion of attitude groups, and a gallery of failures.

    python experiments/recognition_quality.py DATASET RESULTS.csv ANSWERS.json [--trees TREE...] [--out DIR] [--depth D]

RESULTS.csv and ANSWERS.json are what `itree recognize DATASET TREE... -o RESULTS.csv --json ANSWERS.json` wrote. Writes
`reliability.md`, `.svg` and `.json`, `failures.html`, and with the trees `groups.md` and an SVG file for each tree's
confusion. Scenes with failures, with trees all scenes, are looked at again: one or two seconds each.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from quality.attitude_groups import GroupPair
from quality.gallery import Card, write_gallery
from quality.group_pairs import answer_pairs, groups_of_truth, region_pairs, write_confusions
from quality.look_again import Said, failure_cards, load_parts, look_again
from quality.reliability_figure import reliability_diagram
from quality.reliability_tables import reliability_report

from itree_jax.evaluation.judged import JudgedScene, ScoredAnswers, judge_answers, scored_answers
from itree_jax.evaluation.reliability import equal_bins, equal_count_bins
from itree_jax.report.svg_file import standalone


@dataclass(frozen=True)
class Config:
    dataset: Path
    results: Path
    answers: Path
    trees: tuple[Path, ...] = ()
    out: Path = Path("out/recognition_quality")
    depth: str = "auto"  # as the scenes were recognised


def main(config: Config) -> None:
    """Writes everything into `config.out` and prints the tables."""
    config.out.mkdir(parents=True, exist_ok=True)
    judged, answers = judge_answers(config.dataset, config.results), read_answers(config.answers)
    print(write_reliability(config.out, scored_answers(judged)))
    parts = load_parts(config.dataset, config.trees)
    cards: list[Card] = []
    of_answers: dict[str, list[GroupPair]] = {name: [] for name in parts.trees}
    of_regions: dict[str, list[GroupPair]] = {name: [] for name in parts.trees}
    for scene in judged:
        if not parts.trees and not failed(scene):
            continue
        seen = look_again(config.dataset, scene, answers.get(scene.truth.scene_id, {}), parts, config.depth)
        cards += failure_cards(seen) if failed(scene) else []
        for name, prepared in seen.trees.items():
            truths = groups_of_truth(prepared, scene)
            of_answers[name] += answer_pairs(prepared, seen, truths)
            of_regions[name] += region_pairs(prepared, seen, truths)
    write_gallery(config.out / "failures.html", f"Failures of {config.results.stem}", judged, cards)
    if parts.trees:
        print(write_confusions(config.out, parts.trees, of_regions, of_answers))


def failed(scene: JudgedScene) -> bool:
    return not scene.right.all() or len(scene.missed) > 0


def read_answers(path: Path) -> dict[int, Said]:
    """What the JSON says of image 0 of each scene."""
    images = json.loads(path.read_text(encoding="utf-8"))["images"]
    return {image["scene_id"]: image for image in images if image["im_id"] == 0}


def write_reliability(out: Path, scored: ScoredAnswers) -> str:
    """Tables, diagram, and the scores themselves; returns the tables."""
    report = reliability_report(scored)
    bins: Sequence = equal_bins(scored.score, scored.right), equal_count_bins(scored.score, scored.right)
    data = {"score": scored.score.tolist(), "right": scored.right.tolist(),
            "found_visible": scored.found_visible.tolist(), "visible": scored.visible}  # fmt: skip
    (out / "reliability.md").write_text(report)
    (out / "reliability.svg").write_text(standalone(reliability_diagram(*bins, "Reliability of the score")))
    (out / "reliability.json").write_text(json.dumps(data) + "\n")
    return report


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--trees", type=Path, nargs="*", default=[])
    parser.add_argument("--out", type=Path, default=Config.out)
    parser.add_argument("--depth", choices=("auto", "file", "stereo", "none"), default=Config.depth)
    given = vars(parser.parse_args())
    main(Config(**given | {"trees": tuple(given["trees"])}))
