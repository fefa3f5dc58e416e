"""Task 2 of the paper: arrangements of objects on a table, each easy to reach and use."""
