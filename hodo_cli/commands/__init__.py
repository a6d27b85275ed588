"""What each command does, one module each, with the table that it prints, but without the command
line: no click here. Imports all but the command line and the Python interface."""
