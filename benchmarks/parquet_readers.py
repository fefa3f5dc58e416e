"""Reads a Parquet file of scenes, trials or plans with pandas, polars, DuckDB and Hugging Face datasets, those that are installed.

Each reader counts the rows and the satisfied certificates, sums the least margins, and looks into a nested column.
All must agree with pyarrow.

    python benchmarks/parquet_readers.py scenes.parquet
"""

import argparse
import importlib
import math
import tempfile
from pathlib import Path


def by_pyarrow(path):
    import pyarrow.parquet

    rows = pyarrow.parquet.read_table(path).to_pylist()
    return _figures([(row["certificate"], row["condition"]) for row in rows])


def by_pandas(path):
    import pandas

    frame = pandas.read_parquet(path)
    return _figures(list(zip(frame["certificate"], frame["condition"], strict=True)))


def by_polars(path):
    import polars

    certificate = polars.col("certificate").struct
    inner = polars.col("condition").struct.field(_first_list(path)).list.len().sum()
    row = (
        polars.scan_parquet(path)
        .select(
            polars.len().alias("rows"),
            certificate.field("satisfied").sum().alias("satisfied"),
            certificate.field("min_margin").sum().alias("margin"),
            inner.alias("entries"),
        )
        .collect()
        .row(0)
    )
    return row[0], row[1], row[2], row[3]


def by_duckdb(path):
    import duckdb

    name = _first_list(path)
    query = (
        "select count(*), count(*) filter (certificate.satisfied), sum(certificate.min_margin), "
        f"sum(len(condition.{name})) from read_parquet($path)"
    )
    return duckdb.execute(query, {"path": str(path)}).fetchone()


def by_datasets(path):
    import datasets

    with tempfile.TemporaryDirectory() as cache:
        data = datasets.load_dataset(
            "parquet", data_files=str(path), split="train", cache_dir=cache
        )
        figures = _figures([(row["certificate"], row["condition"]) for row in data])
        stream = datasets.load_dataset("parquet", data_files=str(path), streaming=True)
        assert next(iter(stream["train"]))["row"] == data[0]["row"]
    return figures


LISTS = "objects", "contacts", "robots"  # of the condition of a scene, a trial, a plan


def _first_list(path):
    """Name of the condition's list."""
    import pyarrow.parquet

    condition = pyarrow.parquet.read_schema(path).field("condition").type
    return next(name for name in LISTS if condition.get_field_index(name) >= 0)


def _figures(rows):
    lists = [next(c[name] for name in LISTS if name in c) for _, c in rows]
    return (
        len(rows),
        sum(bool(certificate["satisfied"]) for certificate, _ in rows),
        math.fsum(certificate["min_margin"] for certificate, _ in rows),
        sum(map(len, lists)),
    )


READERS = {
    "pyarrow": by_pyarrow,
    "pandas": by_pandas,
    "polars": by_polars,
    "duckdb": by_duckdb,
    "datasets": by_datasets,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    path = parser.parse_args().file
    expected = by_pyarrow(path)
    for name, read in READERS.items():
        try:
            package = importlib.import_module(name)
        except ImportError:
            print(f"{name}: not installed")
            continue
        rows, satisfied, margin, entries = read(path)
        agrees = (rows, satisfied, entries) == (expected[0], expected[1], expected[3])
        agrees &= math.isclose(margin, expected[2], rel_tol=1e-9)
        print(
            f"{name} {package.__version__}: {rows} rows, {satisfied} satisfied, margins {margin:.6f} m, "
            f"{entries} list entries: {'agrees' if agrees else 'DIFFERS'}"
        )


if __name__ == "__main__":
    main()
