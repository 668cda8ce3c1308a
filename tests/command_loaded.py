"""The module that ``tests.command`` forks from: it has imported the command, and read a protocol file once.

Reading the first file builds the grammar's models, which takes as long as the imports.
"""

from tests.shared import codec

codec("diffdrive").encode("status_query")
