"""Results as Parquet tables, written and read in pieces (extra `data`)."""

from .lerobot import Episode, EpisodeFormat, write_lerobot
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
    "Episode",
    "EpisodeFormat",
    "TableInfo",
    "is_table",
    "longest_list",
    "read_info",
    "read_results",
    "table_rows",
    "write_lerobot",
    "write_rows",
]
