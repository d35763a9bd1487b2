"""What the data determine, how sure the answer is, and what would lower the error."""
