"""What a person imports: recordings, tracked motion and models as objects of a notebook."""
