"""Files of experiments and maps with any content: taken, or refused with their path."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from test_fuzz_parameters import SCALARS, VALUES, WORDS, forty

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.lab.experiments.definition import load_experiment
from eulerparams_control.lab.maps.definition import load_map
from eulerparams_control.resources import config_folder, config_names


def leaves(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the way to each value of nested mappings and lists, itself among them."""
    yield path
    pairs = dict(enumerate(content)) if isinstance(content, list) else content
    for key, value in pairs.items() if isinstance(pairs, dict) else ():
        yield from leaves(value, (*path, key))


def replaced(content: Any, path: tuple[Any, ...], value: Any) -> Any:
    """Return a copy of nested mappings and lists with another value in one place."""
    if not path:
        return value
    copy = dict(content) if isinstance(content, dict) else list(content)
    copy[path[0]] = replaced(copy[path[0]], path[1:], value)
    return copy


@pytest.mark.parametrize(("folder", "load"), [("experiments", load_experiment), ("maps", load_map)])
@forty
@given(data=st.data())
def test_a_damaged_file_of_an_experiment_or_a_map_is_taken_or_refused(
    data: st.DataObject, folder: str, load: Any, tmp_path: Path
) -> None:
    name = data.draw(st.sampled_from(config_names(folder)))
    content = yaml.safe_load((config_folder() / folder / f"{name}.yaml").read_text())
    path = data.draw(st.sampled_from(list(leaves(content))))
    value = data.draw(st.none() | VALUES | st.dictionaries(WORDS, SCALARS, max_size=2))
    file = tmp_path / f"{name}.yaml"
    damaged = yaml.safe_dump(replaced(content, path, value), allow_unicode=True)
    file.write_text(damaged, encoding="utf-8")
    refusal = str(file)
    try:
        load(str(file))
    except ConfigurationError as error:
        refusal = str(error)
    assert str(file) in refusal
