"""Parts of torques: coefficients that change with time, and the fluid in a cavity. Imports no
model."""
