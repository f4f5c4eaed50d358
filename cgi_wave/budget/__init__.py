"""Table 1, plans and rankings."""
