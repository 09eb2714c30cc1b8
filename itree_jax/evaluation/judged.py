"""Every answer of a results file beside the true poses: which instance it found, and which ones nothing found."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.evaluation.matching import match
from itree_jax.evaluation.pose_errors import PoseErrors
from itree_jax.evaluation.score import STRICT, VISIBLE, pose_error_table
from itree_jax.evaluation.truth import SceneTruth, load_models, load_truth
from itree_jax.results import BopResults, read_bop_csv


@dataclass(frozen=True)
class JudgedScene:
    """One scene's answers, in the order of the csv, and what they found."""

    truth: SceneTruth
    answers: BopResults
    errors: PoseErrors  # [answers, instances], the MSSD as one of the diameter; inf between different objects
    found: Int[np.ndarray, "answers"]  # instance within 5 % of the diameter, one to one by falling score; -1 wrong

    @property
    def right(self) -> Bool[np.ndarray, "answers"]:
        return self.found >= 0

    @property
    def visible(self) -> Bool[np.ndarray, "instances"]:
        """The instances that recall counts."""
        return self.truth.visible >= VISIBLE

    @property
    def missed(self) -> Int[np.ndarray, "missed"]:
        """Instances visible by 70 % or more that no answer found."""
        return np.setdiff1d(np.flatnonzero(self.visible), self.found)

    @property
    def found_visible(self) -> Bool[np.ndarray, "answers"]:
        """Whether an answer found one of the instances that recall counts."""
        return self.right & np.append(self.visible, False)[self.found]


@dataclass(frozen=True)
class ScoredAnswers:
    """The answers of many scenes, for what depends on their scores alone."""

    score: Float[np.ndarray, "answers"]
    right: Bool[np.ndarray, "answers"]
    found_visible: Bool[np.ndarray, "answers"]  # right, and of an instance that recall counts
    visible: int  # instances that recall counts


def judge_answers(dataset: str | Path, csv: str | Path) -> list[JudgedScene]:
    """Every scene of a data set in the BOP layout with the answers of a BOP csv for its image 0.

    Right is what `evaluate` takes for right at 5 % of the diameter. Raises ItreeError when a file is missing or
    malformed.
    """
    dataset = Path(dataset)
    models, results = load_models(dataset), read_bop_csv(csv)
    scenes = []
    for truth in load_truth(dataset):
        answers = results[(results.scene_id == truth.scene_id) & (results.im_id == 0)]
        errors = pose_error_table(answers, truth, models)
        scenes.append(JudgedScene(truth, answers, errors, match(errors.mssd, answers.score, STRICT)))
    return scenes


def scored_answers(scenes: Sequence[JudgedScene]) -> ScoredAnswers:
    """The answers of all the scenes in one list."""
    return ScoredAnswers(
        np.concatenate([np.zeros(0), *(s.answers.score for s in scenes)]),
        np.concatenate([np.zeros(0, bool), *(s.right for s in scenes)]),
        np.concatenate([np.zeros(0, bool), *(s.found_visible for s in scenes)]),
        sum(int(s.visible.sum()) for s in scenes),
    )
