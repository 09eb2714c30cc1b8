"""From hypotheses to poses: refined, verified, weighed, selected; and the lights corrected by the parts found.

The pose's path: `hypotheses`, `schedule`, `optimise`, `verify`, `likelihood`, `select`, `scoring`, `uncertainty`. The
lights' path: `lit_pixels`, `light_equations`, `pose_terms`, `joint_equations`, `self_calibration`.
"""
