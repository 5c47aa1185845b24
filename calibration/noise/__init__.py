"""The error model: variances, serial correlation, and their estimation by REML."""
