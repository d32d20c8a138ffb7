"""Program that builds random scenes and renders them in Blender, run as ``python -m kit``.

It runs in the Python environment that has ``bpy``, which need not be the one that has occjax:
Blender's wheels support one version of Python and need NumPy 1. So no module here imports occjax or
JAX, and all imports are relative. :mod:`.scene` describes a scene with NumPy alone; only
:mod:`.shading`, :mod:`.stage` and :mod:`.camera` need ``bpy``.
"""
