"""From stiffness and bend to E and nu: routes, theory, and where they end."""
