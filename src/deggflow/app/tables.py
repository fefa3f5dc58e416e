"""Tables of evaluations on the terminal."""

from deggflow.task import Table

from .session import output


def show(table: Table | str) -> None:
    """Prints a table with its note, or plain text."""
    if isinstance(table, str):
        output().print(table, markup=False)
        return
    from rich.table import Table as RichTable

    rich_table = RichTable(title=table.title, title_justify="left")
    for heading in table.headings:
        rich_table.add_column(heading, no_wrap=True)
    for row in table.rows:
        rich_table.add_row(*map(str, row))
    output().print(rich_table)
    if table.note:
        output().print(table.note)
