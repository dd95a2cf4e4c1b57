"""The public interface: recordings, tracked motion and models as objects for a notebook."""
