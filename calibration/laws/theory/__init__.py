"""What theory says of a contact law: stiffness, sticking, and the admissible range of beta."""
