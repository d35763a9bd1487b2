"""Compiled templates, kept between commands.

To compile those of the first screen takes about 0.5 s.
"""

from jinja2 import BytecodeCache
from jinja2.bccache import Bucket

from .. import programs


class KeptTemplates(BytecodeCache):
    """The bytecode of templates, beside the kept programs, of the same source and as private."""

    def load_bytecode(self, bucket: Bucket) -> None:
        path = programs.template_file(bucket.key)
        if content := path and programs.read(path):
            bucket.bytecode_from_string(content)

    def dump_bytecode(self, bucket: Bucket) -> None:
        if path := programs.template_file(bucket.key):
            programs.write(path, bucket.bytecode_to_string())
