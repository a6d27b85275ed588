"""Drawings, and the page that holds them; the only importer of matplotlib."""
