"""The page on localhost on which a person moves the arm, pushes it, and changes its law."""
