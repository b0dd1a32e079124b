from .access import Access as Access
from .server import BenchOptions as BenchOptions
from .server import serve_until_interrupted as serve_until_interrupted
