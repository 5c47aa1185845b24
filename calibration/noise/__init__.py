"""The error model: variances, serial correlation, and their estimation by REML."""

from tactilevision.renamed import names_of

__getattr__ = names_of(__name__)  # of the module that was here before
