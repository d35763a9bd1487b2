"""Table 2 of Li et al. (2023), run again."""
