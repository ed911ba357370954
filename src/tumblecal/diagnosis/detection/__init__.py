"""Is anything wrong at all? The test, and how it falls when nothing is."""
