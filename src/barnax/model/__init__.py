"""One circuit on prepared records: simulated, compressed, and searched in a box."""
