"""Tables of evaluations on the terminal."""

from deggflow.task import Table

from .session import output


def show(table: Table | str) -> None:
    """Prints a table and what it says below, or text as it is."""
    if isinstance(table, str):
        output().print(table, markup=False)
        return
    from rich.table import Table as RichTable

    shown = RichTable(title=table.title, title_justify="left")
    for heading in table.headings:
        shown.add_column(heading, no_wrap=True)
    for row in table.rows:
        shown.add_row(*map(str, row))
    output().print(shown)
    if table.note:
        output().print(table.note)
