"""Dataclasses as data: fields may be added later, and what does not fit its annotation is refused."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
from jaxtyping import Float

from itree_jax.tree.packing import pack, unpack


@dataclass(frozen=True)
class Leaf:
    a: Float[np.ndarray, "n"]
    b: Float[np.ndarray, "n 2"]


@dataclass(frozen=True)
class Old:
    leaf: Leaf
    names: tuple[str, ...]


@dataclass(frozen=True)
class New(Old):
    spread: float = 0.5
    lists: tuple[Float[np.ndarray, "n"], ...] = ()
    note: str | None = None


def leaf(n=3):
    return Leaf(np.arange(n, dtype=np.float32), np.ones((n, 2)))


def through_json(value, cls):
    arrays = {}
    data = json.loads(json.dumps(pack(value, arrays), allow_nan=False))
    return unpack(cls, data, arrays)


def test_a_field_that_is_added_later_gets_its_default():
    assert through_json(Old(leaf(), ("x",)), New).spread == 0.5


def test_a_field_without_default_is_asked_for():
    @dataclass(frozen=True)
    class Needs:
        leaf: Leaf
        depth: int

    with pytest.raises(ValueError, match=r"^depth is missing$"):
        through_json(Old(leaf(), ()), Needs)


@pytest.mark.parametrize("spread", [np.inf, -np.inf, 0.1, 5e-324, 1.0])
def test_numbers_survive_exactly(spread):
    assert through_json(New(leaf(), (), spread), New).spread == spread
    assert np.isnan(through_json(New(leaf(), (), float("nan")), New).spread)


def test_entries_of_a_tuple_may_differ_in_length_but_fields_of_a_class_must_agree():
    lists = (np.zeros(2), np.zeros(5), np.zeros(0))
    found = through_json(New(leaf(), ("x", "y"), lists=lists, note="n"), New)
    assert [len(entry) for entry in found.lists] == [2, 5, 0]
    assert (found.names, found.note) == (("x", "y"), "n")
    with pytest.raises(ValueError, match=r"leaf\.b is float64 \[4, 2\], not Float \[n 2\]"):
        through_json(Old(Leaf(np.zeros(3), np.zeros((4, 2))), ()), Old)


def test_an_array_in_other_byte_order_or_layout_is_the_same_array():
    b = np.asfortranarray(np.arange(6.0).reshape(3, 2))
    found = through_json(Old(Leaf(np.zeros(3), b), ()), Old)
    assert np.array_equal(found.leaf.b, b)


def test_what_is_no_data_is_refused():
    with pytest.raises(TypeError, match=r"names\.0: a function cannot be stored"):
        pack(Old(leaf(), (leaf,)), {})
