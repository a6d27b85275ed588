"""Models that are not hodo's: the sources that they are made of, and what is wrong with them."""
