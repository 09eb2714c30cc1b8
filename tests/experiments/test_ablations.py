"""Steps are left out by replacing functions by name: each of them must still be there."""

import ablations
import pytest

from itree_jax import competition, recognition


@pytest.mark.parametrize("name", ablations.CONFIGURATIONS)
def test_what_a_configuration_leaves_out_is_there_and_comes_back(name):
    before = recognition.search_deeper, recognition.settled, recognition.exact, competition.select
    with ablations.CONFIGURATIONS[name]():
        pass
    assert (recognition.search_deeper, recognition.settled, recognition.exact, competition.select) == before
