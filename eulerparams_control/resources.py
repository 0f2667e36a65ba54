"""The files that come with the package: its ``config`` folder."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

from eulerparams_control.errors import UnknownNameError

PACKAGE = "eulerparams_control"


def _candidates() -> Iterator[Path]:
    yield Path(__file__).resolve().parents[1] / "config"  # a source tree, --symlink-install
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix:
            yield Path(prefix) / "share" / PACKAGE / "config"
    yield Path(sys.prefix) / "share" / PACKAGE / "config"  # pip install


def config_folder() -> Path:
    """Return the folder ``config`` of the source tree or of the installation.

    Raises:
        FileNotFoundError: if neither exists.
    """
    for folder in _candidates():
        if (folder / "robots").is_dir():
            return folder
    raise FileNotFoundError(
        f"the config folder of {PACKAGE} is missing; looked in: "
        + ", ".join(str(folder) for folder in _candidates())
    )


def config_names(folder: str) -> list[str]:
    """Return the names of the YAML files of ``config/<folder>``, sorted."""
    return sorted(path.stem for path in (config_folder() / folder).glob("*.yaml"))


def config_file(folder: str, name: str) -> Path:
    """Return the path of ``config/<folder>/<name>.yaml``.

    Raises:
        UnknownNameError: if there is none; lists those that exist.
    """
    if name not in config_names(folder):
        raise UnknownNameError(folder.rstrip("s"), name, config_names(folder))
    return config_folder() / folder / f"{name}.yaml"
