"""Result files: written, resumed, changed and read."""
