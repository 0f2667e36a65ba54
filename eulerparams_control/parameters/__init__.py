"""The parameters of the nodes, and what is made of them."""
