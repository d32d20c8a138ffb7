"""Scenes and their rendering in Blender: a program of its own, run as ``python -m blender``.

It runs under the Python that has ``bpy``, which need not be the one that has occjax: Blender's
wheels are for one version of Python and for NumPy 1. So nothing here imports occjax or JAX, and all
imports are relative. What a scene consists of is made with NumPy alone (:mod:`.scene`); only
:mod:`.shading`, :mod:`.stage` and :mod:`.camera` need ``bpy``.
"""
