"""JAX, which differentiates energies; an extra, since learning and tracking do without it."""

from eal.needs import MissingPackageError

try:
    import jax
    import jax.numpy as jnp
except ImportError:
    raise MissingPackageError.of("differentiating energies", "mechanics", "jax") from None

__all__ = ["jax", "jnp"]
