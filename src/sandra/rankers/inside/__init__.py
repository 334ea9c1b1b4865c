"""The language model that comes along: read with NumPy, without any framework (docs/embedded.md).

model.py    a forward pass of the Qwen3 architecture
reader.py   a Hugging Face folder of it, as scoring reads it
ranker.py   the ranker `embedded`
weights/    the folder that is shipped
"""
