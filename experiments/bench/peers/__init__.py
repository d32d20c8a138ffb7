"""The published network in other frameworks.

The peers import neither JAX nor occjax, so that each can have its own environment. Every peer is a
module with two functions of a :class:`~experiments.bench.peers.description.Problem`::

    build(problem, **options) -> program     inference; the answer is the disparity [h, w]
    train(problem, **options) -> program     step of Adam; the answer is loss and gradient norm [2]
"""
