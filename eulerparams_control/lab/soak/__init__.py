"""All nodes for a long time, in real time: does anything grow, get slower, or go missing?

``plan``      which controllers, for how long, and what the nodes are told
``histogram`` latencies of any number in bounded memory
``usage``     what a process takes, as the kernel says
``ledger``    which states were answered, and how soon
``cause``     why a state was not
``record``    all that was seen
``verdict``   what must hold
``main``      the command, its table and its page
"""
