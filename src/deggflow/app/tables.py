"""Tables of evaluations on the terminal."""

from deggflow.task import Table

from .session import output

LONGEST = 10_000  # columns of text; longer lines are of no use to anyone


def show(table: Table | str) -> None:
    """Prints a table with its note, or plain text.

    In a terminal, cells that do not fit are wrapped. Elsewhere each row is on one line, however long, so that scripts can
    read it. Nothing is cropped.
    """
    console = output()
    if isinstance(table, str):
        console.print(table, markup=False)
        return
    from rich.measure import Measurement
    from rich.table import Table as RichTable

    rich_table = RichTable(title=table.title, title_justify="left")
    for heading in table.headings:
        rich_table.add_column(heading, no_wrap=not console.is_terminal, overflow="fold")
    for row in table.rows:
        rich_table.add_row(*map(str, row))
    if not console.is_terminal:
        whole = Measurement.get(console, console.options.update_width(LONGEST), rich_table)
        console.width = max(console.width, whole.maximum)
    console.print(rich_table)
    if table.note:
        output().print(table.note)
