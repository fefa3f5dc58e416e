"""Results as Parquet tables, written and read in pieces (extra `data`)."""

from .parquet import (
    TableInfo,
    is_table,
    longest_list,
    read_info,
    read_results,
    table_rows,
    write_rows,
)

__all__ = [
    "TableInfo",
    "is_table",
    "longest_list",
    "read_info",
    "read_results",
    "table_rows",
    "write_rows",
]
