"""NI's DAQmx service on the virtual device, as the NI gRPC Device Server answers it.

In: protobuf requests of a DAQmx client. Out: protobuf responses, or the driver's status as gRPC metadata. What is
answered stands in one table (`calls`); how, in `task`, `channels`, `data`, `properties` and `device`.
"""
