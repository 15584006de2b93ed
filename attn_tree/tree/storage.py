"""Archives: a zip of `meta.json` and `.npy` arrays. No pickle, so opening one never runs code.

Every model of this project is stored this way, trees and networks alike.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

_META = "meta.json"
# A file from elsewhere may claim any size: refuse before unpacking what no model of ours needs.
_MOST_BYTES = 4 << 30


class ArchiveError(ValueError):
    """A model file that is missing, truncated, malformed or hostile; the message is one line."""


def write_archive(path: str | Path, meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Write `meta` (JSON values) and `arrays` to `path`, whole or not at all."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    with zipfile.ZipFile(partial, "w") as archive:
        _add(archive, _META, json.dumps(meta))
        for name, array in arrays.items():
            data = io.BytesIO()
            np.lib.format.write_array(data, np.asarray(array), allow_pickle=False)
            _add(archive, f"{name}.npy", data.getvalue())
    partial.replace(path)


def _add(archive: zipfile.ZipFile, name: str, data: str | bytes) -> None:
    """Add a member without a date: equal models are equal files, and a clock set to 1970 does no harm."""
    member = zipfile.ZipInfo(name)
    member.external_attr = 0o600 << 16  # as `writestr` gives a member that it makes itself
    archive.writestr(member, data, zipfile.ZIP_DEFLATED, compresslevel=1)


def read_archive(path: str | Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read what `write_archive` wrote: `(meta, arrays)`.

    Raises:
        ArchiveError: there is no such file, or it is not such an archive.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(info.file_size for info in archive.infolist()) > _MOST_BYTES:
                raise ArchiveError(f"{path}: it claims more than {_MOST_BYTES >> 30} GiB; not opened")
            meta = json.loads(archive.read(_META))
            arrays = {
                name.removesuffix(".npy"): np.load(io.BytesIO(archive.read(name)), allow_pickle=False)
                for name in archive.namelist()
                if name.endswith(".npy")
            }
    except ArchiveError:
        raise
    except FileNotFoundError:
        raise ArchiveError(f"{path}: no such file; expected a model saved by this project") from None
    except IsADirectoryError:
        raise ArchiveError(f"{path}: is a folder; expected a model file") from None
    except Exception as error:  # zipfile, json and numpy raise a dozen kinds on bad bytes
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise ArchiveError(
            f"{path}: not a model saved by this project, or cut short ({reason}); save it again"
        ) from None
    if not isinstance(meta, dict):
        raise ArchiveError(f"{path}: {_META} holds {type(meta).__name__}; expected an object")
    return meta, arrays
