"""The page on its topics: the node, its publishers, and the services that it calls."""
