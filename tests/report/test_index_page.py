"""The index: failures first, links that lead to the pages."""

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from itree_jax.detections import Detections
from itree_jax.report.index_page import IndexEntry, report_scene, write_index
from itree_jax.report.scene_page import write_scene_report

from .chromium import ask

MOST_BYTES = 10_000_000
PICTURE = np.zeros((6, 8, 3), np.uint8)


def entry(k: int, score: float | None, page: Path = Path("a.html")) -> IndexEntry:
    return IndexEntry(page, k, 0, f"Scene <{k}>", 0 if score is None else 3, score, 2, 1.5, PICTURE)


@given(st.lists(st.one_of(st.none(), st.floats(0.0, 1.0)), max_size=12))
def test_failures_come_first_then_the_least_best_score(scores):
    ordered = sorted((entry(k, s) for k, s in enumerate(scores)), key=lambda e: e.order)
    failed = [e.failed for e in ordered]
    assert failed == sorted(failed, reverse=True)
    shown = [e.best_score for e in ordered if e.best_score is not None]
    assert shown == sorted(shown)
    for a, b in pairwise(ordered):
        assert a.best_score != b.best_score or a.scene_id < b.scene_id


def test_the_page_lists_all_scenes_in_that_order(tmp_path, self_contained):
    scores = [0.9, None, 0.3, None]
    pages = [tmp_path / "deep" / f"scene&{k}.html" for k in range(4)]
    write_index(tmp_path, [entry(k, s, p) for k, (s, p) in enumerate(zip(scores, pages, strict=True))])
    page = self_contained((tmp_path / "index.html").read_text(encoding="utf-8"))
    links = [link for link in page.attributes("href") if link.endswith(".html")]
    assert links == [f"deep/scene&{k}.html" for k in (1, 3, 2, 0)]
    assert re.findall(r"Scene <(\d)>", page.text) == ["1", "3", "2", "0"]
    assert page.text.count("nothing recognised") == 2
    assert page.text.count("low score") == 1
    assert "4 scenes" in page.text


def test_what_the_truth_calls_wrong_or_missed_comes_right_after_what_has_no_pose():
    fine, none = entry(0, 0.3), entry(1, None)
    missed, wrong = replace(entry(2, 0.9), wrong=0, missed=1), replace(entry(3, 0.99), wrong=2, missed=1)
    right, doubtful = replace(entry(4, 0.9), wrong=0, missed=0), replace(entry(5, 0.9), wrong=0, missed=0, ambiguous=1)
    ordered = sorted([fine, none, missed, wrong, right, doubtful], key=lambda e: e.order)
    assert [e.scene_id for e in ordered] == [1, 3, 2, 0, 5, 4]
    assert [e.failed for e in ordered] == [True] * 3 + [False] * 3


def test_200_scenes_are_light_fast_and_are_sorted_and_filtered_in_a_browser(tmp_path):
    noise = np.random.default_rng(0).integers(0, 60, (240, 320, 3), np.uint8)
    entries = [
        replace(entry(k, None if k % 50 == 0 else 0.4 + k / 400), thumbnail=noise, ambiguous=int(k % 20 == 3), time=k)
        for k in range(200)
    ]
    write_index(tmp_path, entries)
    path = tmp_path / "index.html"
    assert path.stat().st_size < MOST_BYTES
    said = ask(path, """
        const cards = () => [...document.querySelectorAll('.cards a')];
        const shown = () => cards().filter(a => !a.hidden).map(a => +a.dataset.scene);
        const set = (name, value) => { const c = document.querySelector(`.filters [name=${name}]`); c.value = value;
                                       c.dispatchEvent(new Event('input')); };
        const first = shown(); set('sort', 'time'); const slow = shown();
        set('show', 'ambiguous'); const doubtful = shown();
        set('show', 'failed'); const failed = shown(); set('show', ''); set('find', '0017'); const one = shown();
        return {first, slow, doubtful, failed, one, told: document.querySelector('.filters output').textContent,
                wide: document.documentElement.scrollWidth,
                loaded: performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd};
    """, tmp_path, 390)  # fmt: skip
    assert said["wrong"] == said["console"] == []
    assert said["first"][:5] == [0, 50, 100, 150, 1]
    assert said["slow"] == list(range(199, -1, -1))
    assert sorted(said["doubtful"]) == list(range(3, 200, 20))
    assert sorted(said["failed"]) == [0, 50, 100, 150]
    assert sorted(said["one"]) == [17, 117, *range(170, 180)]
    assert said["told"] == "12 of 200 scenes"
    assert said["wide"] <= 390
    assert said["loaded"] < 2000.0


def test_no_scene_is_an_empty_index(tmp_path, self_contained):
    write_index(tmp_path, [])
    assert self_contained((tmp_path / "index.html").read_text(encoding="utf-8")).count("img") == 0


def test_an_entry_sums_up_its_scene_and_its_page_is_written(tmp_path, scene, detections, tree):
    e = report_scene(tmp_path / "s.html", scene, detections, [tree])
    write_scene_report(tmp_path / "t.html", scene, detections, [tree])
    assert (tmp_path / "s.html").read_bytes() == (tmp_path / "t.html").read_bytes()
    assert (e.scene_id, e.count, e.best_score, e.lost, e.time) == (7, 2, 0.875, 1, 0.5)
    nothing = report_scene(tmp_path / "s.html", scene, Detections(), [tree])
    assert nothing.failed
    assert nothing.thumbnail.shape == e.thumbnail.shape
    assert (nothing.thumbnail != e.thumbnail).any()
