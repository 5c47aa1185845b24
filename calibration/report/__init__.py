"""Sentences, figures and pages of results."""
