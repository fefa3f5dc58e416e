"""A dataset larger than memory: a file of records of fixed size, of which training reads those of its next steps."""

import json
from collections.abc import Iterable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Int

from deggflow.files import StrPath, replacing, write_atomically
from deggflow.jsonl import InputError, read_json

from .settings import Dataset

VERSION = 1  # of the file


class StoredDataset:
    """A dataset in a file.

    Attributes:
        path: The file of records; its header lies beside it.
        count: Number of samples.
        row_bytes: Bytes of a sample.
        structure: Shapes and dtypes of all samples together, as a `Dataset`.
        digests: SHA-256 of each leaf's bytes, as if it were one array, in the order of the leaves.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> data = Dataset(np.ones((3, 2, 1)), np.zeros(3), np.ones((3, 2), bool))
        >>> with TemporaryDirectory() as folder:
        ...     store(folder + "/data.records", [data], {})
        ...     stored = StoredDataset(folder + "/data.records", data)
        ...     print(stored.count, stored.rows(np.array([2, 0])).z.shape)
        3 (2, 2, 1)
    """

    def __init__(self, path: StrPath, like: Dataset) -> None:
        """Opens a file that `store` wrote.

        Args:
            path: The file of records.
            like: A dataset of any number of samples with the same leaves.

        Raises:
            InputError: The file or its header is missing or damaged, or has other leaves.
        """
        self.path = Path(path)
        header = read_header(self.path)
        leaves, tree = jax.tree.flatten(like)
        self._dtype = record_type(like)
        if header is None or header.get("record") != _text(self._dtype):
            raise InputError("holds no records of these data; remove it", file=self.path)
        self.count, self.row_bytes = int(header["count"]), self._dtype.itemsize
        self.digests: list[str] = list(header["digests"])
        if self.path.stat().st_size != self.count * self.row_bytes:
            raise InputError(
                f"must have {self.count * self.row_bytes} bytes, for {self.count} samples; remove it",
                file=self.path,
            )
        shapes = [
            jax.ShapeDtypeStruct((self.count, *leaf.shape[1:]), np.asarray(leaf).dtype)
            for leaf in leaves
        ]
        self.structure: Dataset = jax.tree.unflatten(tree, shapes)

    def rows(self, index: Int[np.ndarray, " rows"]) -> Dataset:
        """The samples of these numbers as NumPy arrays; one of them may be wanted several times."""
        out = np.empty(len(index), self._dtype)
        octets = out.view(np.uint8).reshape(len(index), self.row_bytes)
        with self.path.open("rb", buffering=0) as file:  # not mapped: pages would count as resident
            for k in np.argsort(index, kind="stable"):
                file.seek(int(index[k]) * self.row_bytes)
                if file.readinto(octets[k].data) != self.row_bytes:
                    raise InputError("was shortened while it was being read", file=self.path)
        names = self._dtype.names or ()
        return jax.tree.unflatten(jax.tree.structure(self.structure), [out[name] for name in names])


def record_type(like: Dataset) -> np.dtype[Any]:
    """The type of a record that holds one sample's leaves."""
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(like)]
    return np.dtype([(f"{k}", leaf.dtype, leaf.shape[1:]) for k, leaf in enumerate(leaves)])


def _text(record: np.dtype[Any]) -> list[list[Any]]:
    return [[str(record[k].base), list(record[k].shape)] for k in range(len(record.names or ()))]


def header_path(path: Path) -> Path:
    """Path of the header of a file of records."""
    return path.with_name(path.name + ".json")


def read_header(path: Path) -> dict[str, Any] | None:
    """The header of a file of records; None if there is no whole one of this version."""
    try:
        header = read_json(header_path(path))
    except (FileNotFoundError, InputError):
        return None
    return header if header.get("version") == VERSION and path.exists() else None


def store(path: StrPath, chunks: Iterable[Dataset], source: Mapping[str, Any]) -> None:
    """Writes a dataset chunk by chunk.

    Args:
        path: The file, which appears with its header once it is complete.
        chunks: Parts of the dataset in order; all have the same leaves.
        source: JSON values that identify what the data were made from, for `is_stored`.
    """
    path, digests, count = Path(path), list[Any](), 0
    with replacing(path) as temporary, temporary.open("wb") as file:
        for chunk in chunks:
            leaves = [np.ascontiguousarray(leaf) for leaf in jax.tree.leaves(chunk)]
            record = record_type(chunk)
            digests = digests or [sha256() for _ in leaves]
            rows = np.empty(len(leaves[0]), record)
            for name, leaf, digest in zip(record.names or (), leaves, digests, strict=True):
                rows[name] = leaf
                digest.update(leaf.reshape(-1).view(np.uint8).data)
            file.write(rows.tobytes())
            count += len(rows)
        header = {
            "version": VERSION,
            "source": dict(source),
            "count": count,
            "record": _text(record),
            "digests": [digest.hexdigest() for digest in digests],
        }
        header_path(path).unlink(missing_ok=True)
    write_atomically(header_path(path), json.dumps(header, indent=2) + "\n")


def is_stored(path: StrPath, source: Mapping[str, Any]) -> bool:
    """Whether a file holds the records of this source."""
    header = read_header(Path(path))
    return header is not None and header.get("source") == json.loads(json.dumps(dict(source)))
