"""What circuits of several tools leave on public records that they were not fitted to."""
