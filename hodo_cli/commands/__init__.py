"""What each command does, one module each, without the command line: no click here. Imports all but
the command line, the Python interface and the printed tables."""
