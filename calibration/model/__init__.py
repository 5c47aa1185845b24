"""A model: a contact law and effects, composed in stages, with parameters."""

from tactilevision.renamed import names_of

__getattr__ = names_of(__name__)  # of the module that was here before
