"""BOP errors and rates of a results file against a data set.

| name | what it is |
|---|---|
| `evaluate` | data set + csv -> `Report` |
| `Report`, `GroupReport`, `Rate` | the figures per group, rates with Wilson's 95 % interval |
| `mssd`, `mspd`, `add_s`, `Pose` | the errors of poses |
| `SymmetrySet`, `symmetry_set` | the symmetries of a models_info.json entry |
| `match` | estimates to instances, one to one by falling score |
| `judge_answers`, `JudgedScene` | every answer beside the true poses: what it found, what is missed |
| `equal_bins`, `equal_count_bins`, `calibration_error`, `score_thresholds` | how far a score can be believed |
"""

from itree_jax.evaluation.judged import JudgedScene as JudgedScene
from itree_jax.evaluation.judged import judge_answers as judge_answers
from itree_jax.evaluation.judged import scored_answers as scored_answers
from itree_jax.evaluation.matching import match as match
from itree_jax.evaluation.pose_errors import Pose as Pose
from itree_jax.evaluation.pose_errors import add_s as add_s
from itree_jax.evaluation.pose_errors import mspd as mspd
from itree_jax.evaluation.pose_errors import mssd as mssd
from itree_jax.evaluation.reliability import calibration_error as calibration_error
from itree_jax.evaluation.reliability import equal_bins as equal_bins
from itree_jax.evaluation.reliability import equal_count_bins as equal_count_bins
from itree_jax.evaluation.reliability import score_thresholds as score_thresholds
from itree_jax.evaluation.report import GroupReport as GroupReport
from itree_jax.evaluation.report import Rate as Rate
from itree_jax.evaluation.report import Report as Report
from itree_jax.evaluation.report import wilson_interval as wilson_interval
from itree_jax.evaluation.score import evaluate as evaluate
from itree_jax.evaluation.symmetry import SymmetrySet as SymmetrySet
from itree_jax.evaluation.symmetry import symmetry_set as symmetry_set
