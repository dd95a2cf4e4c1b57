"""Motion models that fill gaps, one a file: each has settings, is fitted to trials, and fills one of them."""
