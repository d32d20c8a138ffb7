"""occjax: disparity from light fields by occlusion-aware cascade cost volumes, in JAX."""
