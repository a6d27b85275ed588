"""What is stored of a motion and what follows from it: names and units, quantities, datasets, and
which results are still right. Imports storage, integration and the folders below."""
