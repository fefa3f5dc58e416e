"""`deggflow reproduce`: every experiment of the paper, measured, drawn and put into one report."""
