"""Results for people: words, tables, figures and pages."""
