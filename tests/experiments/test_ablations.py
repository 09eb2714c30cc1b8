"""Steps are left out by replacing functions by name: each of them must still be there."""

import ablations
import pytest

from itree_jax import competition, recognition


@pytest.mark.parametrize("name", ablations.CONFIGURATIONS)
def test_what_a_configuration_leaves_out_is_there_and_comes_back(name):
    def steps():
        return (recognition.search_deeper, recognition.settled, recognition.exact, recognition.subtract_reflections,
                competition.select)  # fmt: skip

    before = steps()
    with ablations.CONFIGURATIONS[name]():
        pass
    assert steps() == before
