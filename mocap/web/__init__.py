"""Pages of this computer for its user alone: by a Starlette application.

Routes come in. An address with a secret goes out. It touches a port of 127.0.0.1, and a file of mode 0600 that
forwards a browser to it.

``page`` makes the application of routes whose requests have a schema (``task``), ``Guard`` stands before it and refuses
what does not come from the page itself, ``served`` runs it by uvicorn on 127.0.0.1. The room knows nothing of what is
shown.
"""

from eal.needs import needs

needs("a page in the browser", "web", "starlette", "uvicorn", "pydantic")
