"""NI's RPC services on the virtual device: in process and over TCP, as the NI gRPC Device Server answers.

In: protobuf requests of any DAQmx client.
Out: protobuf responses, event streams, or the driver's status as gRPC metadata. The calls stand in tables by their
names: `device`, `task`, `channels` (timing, too), `data` (waveforms, too).
"""
