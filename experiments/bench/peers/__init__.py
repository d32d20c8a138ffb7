"""The same network in other frameworks, written plainly from the paper's description.

They import neither JAX nor occjax, so that each can live in an environment of its own. Every peer
is a module with two functions of a :class:`~experiments.bench.peers.description.Problem`::

    build(problem, **options) -> program     whose answer is the disparity [h, w]
    train(problem, **options) -> program     a step of Adam; loss and norm of the gradient [2]
"""
