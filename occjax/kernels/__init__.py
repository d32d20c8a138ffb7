"""Private fast implementations. Each module names the reference implementation.

``tests/kernels`` compares each function with its reference.

* :mod:`occjax.kernels.bilinear`: bilinear taps, reads of single planes and of packed pairs;
* :mod:`occjax.kernels.convolution`: 2-D convolution with a fast kernel gradient on a CPU;
* :mod:`occjax.kernels.minimal_filtering`: 3x3x3 convolution with half of the multiplications;
* :mod:`occjax.kernels.volume_convolution`: 3x3x3 convolution with fast gradients;
* :mod:`occjax.kernels.median`: median of 3x3 pixels;
* :mod:`occjax.kernels.reductions`: reductions over the leading axis of a stack of maps.
"""
