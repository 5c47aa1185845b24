"""From stiffness and nonlinearity to E and nu: the routes, and the result."""
