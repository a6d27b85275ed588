"""What is stored of a motion, and what follows from it: names and units, quantities, datasets.
Imports storage, integration and what lies below."""
