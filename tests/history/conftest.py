"""Stored texts."""

from snapshot_texts import snapshot as snapshot
