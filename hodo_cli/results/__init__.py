"""What is stored of a motion, and what follows from it: names and units, quantities, datasets, and
what of a result need not be done again.
Imports storage, integration and what lies below."""
