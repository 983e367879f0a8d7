"""What is scored on what; stored runs, tables and figures."""
