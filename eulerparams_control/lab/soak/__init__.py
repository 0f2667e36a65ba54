"""All nodes for a long time, in real time: does anything grow, get slower, or go missing?

``plan``      which controllers, for how long, and what the nodes are told
``ledger``    which states were answered, and how soon, in bounded memory
``cause``     why a state was not answered
``record``    all that was seen, and what each process takes
``verdict``   what must hold
``main``      the command; ``summary`` its numbers and tables, ``page`` its page
"""
