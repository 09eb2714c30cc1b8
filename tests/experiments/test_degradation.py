"""Scenes made worse: each condition does what it says, answers are counted as they are judged, finished scenes kept."""

import json

import degradation
import numpy as np
import pytest
from degrading.conditions import CURVES, NOMINAL, Condition, steps
from degrading.counting import step_of
from degrading.imaging import scene_of, sensor_of, stains, told_sensor, turned
from itree_cad.bundled import bundled_part

from itree_jax.simulate import bin_for

PART = bundled_part("bracket")
LYING = np.eye(4)[None]


def scene(condition):
    return scene_of(PART, LYING, bin_for(sensor_of(NOMINAL), PART.diameter), condition, seed=3)


def test_conditions_are_kept_under_names_of_their_own():
    names = [condition.name for condition in steps(quick=False)]
    assert len(set(names)) == len(names)
    assert steps(quick=True) == [NOMINAL, *(curve[-1] for curve in CURVES.values())]


@pytest.mark.parametrize("share", [0.3, 0.6])
def test_a_plate_hides_the_share_that_it_is_to_hide(share):
    _, truth = scene(Condition(hidden=share))
    assert len(truth) == 1
    assert truth[0].visib_fract == pytest.approx(1.0 - share, abs=0.03)  # pixels along an edge of 60


def test_every_light_is_turned_by_the_angle():
    L = sensor_of(NOMINAL).light_directions
    other = turned(L, 5.0, np.random.default_rng(0))
    np.testing.assert_allclose(np.degrees(np.arccos((L * other).sum(axis=1))), 5.0, atol=1e-9)
    assert turned(L, 0.0, np.random.default_rng(0)) is L


def test_stains_have_their_deviation():
    log = np.log(stains((120, 160), 0.2, 8.0, np.random.default_rng(0)))
    assert log.std() == pytest.approx(0.2, rel=1e-3)
    assert np.abs(np.diff(log, axis=0)).max() < 0.2  # smooth: far less than white noise of this deviation


def test_another_scale_shows_the_same_view():
    one, four = sensor_of(Condition(scale=0.5)), sensor_of(Condition(scale=2.0))
    for camera, k in ((one.camera, 0.5), (four.camera, 2.0)):
        assert (camera.width, camera.height) == (320 * k, 240 * k)
        corner = camera.unproject(np.array([-0.5, -0.5]), np.array(900.0))
        np.testing.assert_allclose(corner, [-900 * 160 / 907.5, -900 * 120 / 907.5, 900.0])


def test_a_dark_light_shows_noise_and_one_left_out_is_not_told():
    lit, _ = scene(NOMINAL)
    dark, _ = scene(Condition(dark=True))
    assert (degradation.refused(lit), degradation.refused(dark)) == (False, True)
    assert lit.images[0].mean() > 0.05
    assert dark.images[0].max() < 0.01  # of full scale: read noise
    np.testing.assert_array_equal(dark.images[1:].shape, lit.images[1:].shape)
    out, _ = scene(Condition(lights=4, missing=True))
    assert (len(out.images), out.sensor.light_count, sensor_of(Condition(lights=4)).light_count) == (3, 3, 4)
    np.testing.assert_array_equal(told_sensor(Condition(lights=4, missing=True)).light_directions,
                                  sensor_of(Condition(lights=4)).light_directions[1:])  # fmt: skip


def test_noise_grows_as_it_says_while_the_sensor_states_the_same():
    quiet, loud = scene(NOMINAL)[0], scene(Condition(noise=8.0))[0]
    flat = (slice(None), slice(5, 25), slice(5, 25))  # of the table beside the bin
    assert loud.images[flat].std() == pytest.approx(8.0 * quiet.images[flat].std(), rel=0.2)
    assert loud.sensor.noise == quiet.sensor.noise


def answer(score, ambiguous, right):
    return {"score": score, "ambiguous": ambiguous, "right": right, "mssd": 0.01}


def test_ambiguous_answers_are_counted_apart():
    answers = [answer(1.0, False, True), answer(0.5, True, False)]
    one = {"visible": 3, "found": 2, "warned": [], "refused": False, "answers": answers}
    none = {"visible": 2, "found": 0, "warned": ["dark"], "refused": True, "answers": []}
    found = step_of(NOMINAL, [one, none])
    assert (found.top_pick.count, found.top_pick.total) == (1, 2)
    assert (found.recall.count, found.recall.total) == (2, 5)
    assert (found.precision.count, found.precision.total) == (1, 1)
    assert (found.precision_all.count, found.precision_all.total) == (1, 2)
    assert (found.silent, found.warned, found.refused) == (1, 1, 1)


def test_finished_scenes_are_not_done_again(tmp_path, monkeypatch):
    monkeypatch.setattr(degradation, "recognised", None)  # would fail when called
    config = degradation.Config(quick=True, out=tmp_path)
    record = {"visible": 4, "found": 3, "warned": [], "refused": False, "answers": [answer(0.9, False, True)]}
    (tmp_path / "scenes").mkdir()
    for condition in steps(quick=True):
        (tmp_path / "scenes" / f"{config.parts[0]}, 0, {condition.name}.json").write_text(json.dumps(record))
    found = degradation.main(config)
    assert [step.recall.count for step in found] == [3] * 7
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["steps"][0]["recall"]["fraction"] == 0.75
    assert (tmp_path / "curves.png").stat().st_size > 10_000
    assert (tmp_path / "table.md").read_text().count("\n") == 2 + 7
