"""The kinds of figures, a function each, which draws an entry of a `figures:` block on a sheet;
`cases.figure_block` declares the keys that each takes."""
