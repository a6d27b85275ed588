"""What is stored of a motion, and what follows from it: names and units, quantities, datasets, how
far two results are apart, and trials of methods.
Imports storage, integration and what lies below."""
