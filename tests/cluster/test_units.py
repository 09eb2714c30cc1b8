"""Units of work on this machine: what is done stays, what fails is told, and the same work gives the same bytes."""

import json

import pytest
from itree_kernels.errors import ItreeError

from itree_jax.cluster import Product, ThisMachine, Unit, digest_of_listing, key_of, run_units
from itree_jax.cluster.run import check_failures
from itree_jax.cluster.unit import Failed, attempt

NAMES = ("a", "b", "c", "d")


def units_of(tasks, key=""):
    return [Unit(name, key_of(task=task, key=key), task) for name, task in zip(NAMES, tasks, strict=False)]


def doubled(task):
    if task < 0:
        raise ItreeError(f"{task} is negative")
    return Product({f"{task}.txt": f"{2 * task}\n".encode(), f"more/{task}.txt": b"m"}, {"task": task})


def quiet(what, share):
    pass


def run(units, folder, work=doubled):
    return run_units(units, work, folder, ThisMachine(), quiet)


def files_of(folder):
    """All but the records, which tell seconds."""
    every = {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
    return {name: content for name, content in every.items() if not name.startswith("units/")}


def test_every_unit_is_done_and_its_files_are_there(tmp_path):
    told = []
    ran = run_units(units_of([1, 2]), doubled, tmp_path / "out", ThisMachine(), lambda *said: told.append(said))
    assert files_of(tmp_path / "out") == {"1.txt": b"2\n", "2.txt": b"4\n", "more/1.txt": b"m", "more/2.txt": b"m"}
    assert ([one.record for one in ran.done], ran.resumed, ran.failures) == ([{"task": 1}, {"task": 2}], 0, {})
    assert [share for _, share in told] == [0.5, 1.0]


def test_a_run_that_was_broken_off_is_gone_on_with_and_gives_the_same_bytes(tmp_path):
    asked = []

    def breaks_off(task):
        asked.append(task)
        if task == 3 and asked.count(3) == 1:
            raise KeyboardInterrupt
        return doubled(task)

    with pytest.raises(KeyboardInterrupt):
        run(units_of([1, 2, 3, 4]), tmp_path / "broken", breaks_off)
    ran = run(units_of([1, 2, 3, 4]), tmp_path / "broken", breaks_off)
    assert (asked, ran.resumed) == ([1, 2, 3, 3, 4], 2)
    run(units_of([1, 2, 3, 4]), tmp_path / "straight")
    assert files_of(tmp_path / "broken") == files_of(tmp_path / "straight")


def test_a_unit_is_done_again_when_its_inputs_its_files_or_its_record_are_not_the_same(tmp_path):
    units = units_of([1, 2])
    run(units, tmp_path)
    assert run(units, tmp_path).resumed == 2
    assert run(units_of([1, 2], key="another tree"), tmp_path).resumed == 0
    assert run(units, tmp_path).resumed == 0
    (tmp_path / "1.txt").write_text("changed")
    assert run(units, tmp_path).resumed == 1
    assert (tmp_path / "1.txt").read_text() == "2\n"
    (tmp_path / "2.txt").unlink()
    assert run(units, tmp_path).resumed == 1
    record = tmp_path / "units" / "a.json"
    whole = json.loads(record.read_text())
    for spoilt in ("{", "[]", json.dumps({"key": units[0].key}), json.dumps(whole | {"files": ["1.txt"]})):
        record.write_text(spoilt)
        assert run(units, tmp_path).resumed == 1
    assert run(units, tmp_path).resumed == 2


def test_failures_are_told_and_the_others_go_on(tmp_path):
    ran = run(units_of([1, -2, 3, -4]), tmp_path)
    assert [one.name for one in ran.done] == ["a", "c"]
    assert ran.failures == {"b": "-2 is negative", "d": "-4 is negative"}
    assert json.loads((tmp_path / "failures.json").read_text()) == ran.failures
    with pytest.raises(ItreeError, match=r"2 of 4 parts failed(.|\n)*b: -2 is negative\n  d: -4 is negative"):
        check_failures(ran, "parts", tmp_path)
    mended = run(units_of([1, 2, 3, 4]), tmp_path)
    assert (mended.resumed, mended.failures) == (2, {})
    assert not (tmp_path / "failures.json").exists()
    check_failures(mended, "parts", tmp_path)


def test_many_failures_are_told_in_part(tmp_path):
    units = [Unit(f"{k:03d}", "", -1 - k) for k in range(30)]
    ran = run(units, tmp_path)
    with pytest.raises(ItreeError) as caught:
        check_failures(ran, "parts", tmp_path)
    assert str(caught.value).count("is negative") == 10
    assert "and 20 more" in str(caught.value)


def test_a_mistake_of_the_program_fails_its_unit_with_its_place():
    def mistaken(task):
        return task["missing"]

    result = attempt(mistaken, {}).result
    assert isinstance(result, Failed)
    assert "a mistake of this program" in result.reason
    assert "KeyError: 'missing'" in result.reason
    assert "in mistaken" in result.reason


def test_units_that_would_be_kept_under_one_name_are_refused(tmp_path):
    with pytest.raises(ItreeError, match="two of the name a"):
        run([*units_of([1]), *units_of([2])], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ItreeError, match="cannot be written"):
        run(units_of([1]), tmp_path / "file")


def test_a_key_tells_its_inputs_apart(tmp_path):
    assert key_of(a=1, b=[2]) == key_of(b=[2], a=1)
    assert len({key_of(a=1), key_of(a=2), key_of(b=1), key_of(a="1"), key_of(a=[1])}) == 5
    (tmp_path / "image").write_text("one")
    before = digest_of_listing([tmp_path / "image"])
    assert digest_of_listing([tmp_path / "image"]) == before
    (tmp_path / "image").write_text("three")
    assert digest_of_listing([tmp_path / "image"]) != before
