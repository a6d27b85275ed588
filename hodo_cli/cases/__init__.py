"""What a case file may say, and the frozen cases that it becomes. Imports models, schema and text;
knows no solver and no result file."""
