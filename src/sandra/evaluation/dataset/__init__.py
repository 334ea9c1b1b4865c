"""Data sets on disk: recordings of many episodes, rows of many scenarios, and their cards."""
