"""betterbench: a diagnostic benchmark that tells why a Vision-Language-Action policy fails."""

__version__ = "0.1.0"
