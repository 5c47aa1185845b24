"""The catalogue of public names is whole: each can be had, each is documented."""

from __future__ import annotations

import pytest

import tactilevision


@pytest.mark.parametrize("name", tactilevision.__all__)
def test_a_public_name_is_there_and_says_what_it_is(name: str) -> None:
    assert getattr(tactilevision, name).__doc__


def test_the_catalogue_names_what_can_be_loaded() -> None:
    assert sorted(tactilevision._HOME) == sorted(tactilevision.__all__)
    assert set(tactilevision.__all__) <= set(dir(tactilevision))


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        tactilevision.nonsense  # noqa: B018 - the look-up itself is the test
