"""The scenario: its schema, the shipped files and roads, and what each may set."""
