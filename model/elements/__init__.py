"""What a scene is made of, each written once: bodies, contacts and their laws, springs, drives, joints, strings.

An element gives its forces, and the energy that it stores and loses, as statements over expressions
(`model.compiler`); all that jobs ask for is derived from these.
"""
