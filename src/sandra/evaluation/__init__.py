"""What the whole achieves on many scenarios: tables with the command that made them beside."""
