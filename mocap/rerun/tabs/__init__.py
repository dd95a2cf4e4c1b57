"""The tabs of the viewer: each is one file that logs what it shows and says how it is laid out."""
