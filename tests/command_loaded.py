"""What ``tests.command`` forks from has imported this: the command, with a protocol file read once.

Reading the first file builds the grammar's models, which takes as long as the imports.
"""

from tests.shared import codec

codec("diffdrive").encode("status_query")
