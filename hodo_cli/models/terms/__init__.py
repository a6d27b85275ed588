"""What a case may give as a term: coefficients that change with time, and the fluid in a cavity.
Imports no model."""
