"""What is left of the optimizers away from the origin."""
