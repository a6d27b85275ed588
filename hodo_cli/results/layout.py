"""The names in a result file."""

SUMMARY = {
    "model": str,
    "form": str,
    "method": str,
    "steps": int,
    "run_time": float,
    "error": float,
    "status": str,
    "message": str,
    "warnings": str,
}
"""The attributes of a case that its line in a table shows."""
