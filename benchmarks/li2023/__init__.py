"""Li et al. (2023): their tables run again, and their optimizers held against other work."""
