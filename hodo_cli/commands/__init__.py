"""The work of each command, one module each, and the table that it prints, without the command
line: no click here. Imports all but the command line and the Python interface."""
