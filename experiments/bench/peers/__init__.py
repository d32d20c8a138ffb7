"""The same network in other frameworks, written plainly from the paper's description.

They import neither JAX nor occjax, so that each can live in an environment of its own. Every peer
is a module with one function::

    build(network, variables) -> run(views) -> disparity

of a :class:`~experiments.bench.peers.description.Network`, its variables by name (``[v, u, h, w]``
float32 views in, ``[h, w]`` float32 out, all NumPy).
"""
