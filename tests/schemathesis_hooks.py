"""Bodies of media types that the fuzzer cannot write by itself: bytes, sent as they are."""
import schemathesis


@schemathesis.serializer("model/obj", "model/gltf-binary", "model/gltf+json")
def mesh(_context, value):
    return value
