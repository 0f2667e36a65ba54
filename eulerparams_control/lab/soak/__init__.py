"""All nodes for a long time, in real time: does anything grow, get slower, or go missing?

``ledger``    which states were answered, and how soon, in bounded memory
``cause``     why a state was not answered
``record``    what is run, all that was seen of it, and what each process takes
``verdict``   what must hold
``main``      the command; ``summary`` its numbers and tables, ``page`` its page
"""
