"""What people read and look at: sentences, figures, pages."""
