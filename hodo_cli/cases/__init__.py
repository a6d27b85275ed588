"""What a case file may say, and the frozen cases that it becomes. Imports models and schema;
knows no solver and no result file."""
