"""A DDS domain through Cyclone DDS: who publishes what, of which type, and the payloads as they came.

Python's ``cyclonedds`` builds a Python class for each type and decodes every sample. A recorder needs
neither: from the type information that a writer sends, Cyclone DDS makes a topic of exactly that type
(``dds_create_topic_descriptor``), and ``dds_takecdr`` gives the payload with its encapsulation. Both belong
to the C interface of the library that the package brings along, and are called here by name.

A payload has the representation that its writer chose (XCDR1 or XCDR2), in the byte order of this machine.
Where several writers of a topic offer different qualities of service, each kind of offer gets a reader of its
own that asks for exactly what is offered; a reader passes on the samples of its own writers alone.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, Self

from cyclonedds import _clayer
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import (
    DDSException,
    Entity,
    InstanceState,
    Policy,
    Qos,
    ReadCondition,
    SampleState,
    ViewState,
)
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl._typesupport.DDS.XTypes import TypeObject
from cyclonedds.internal import DDS, dds_c_t
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from ident.errors import IdentError, UsageError
from ident.record.type_text import COMPLETE, UntoldType, type_text

MOST_SAMPLES = 256
MOST_ROUNDS = 64
ANY_STATE = 0x7F
HANDLE = (1 << 64) - 1
NO_TYPE = "its writer sends no type information"
_GLOBAL_SCOPE = 0
_MILLISECOND = 1_000_000
_MATCHED = ("Reliability", "Durability", "Ownership", "LatencyBudget", "Partition", "DataRepresentation")

_library = DDS._dll_handle  # noqa: SLF001 (the library that the package has loaded)
_Pointer = ctypes.c_void_p


def _function(name: str, result: Any, *arguments: Any) -> Any:
    function = _library[name]  # one of our own: the package keeps those that it looks up by attribute
    function.restype, function.argtypes = result, arguments
    return function


_Pointers = ctypes.POINTER(_Pointer)
_entity, _int, _size = dds_c_t.entity, ctypes.c_int32, ctypes.c_size_t
_read_instance = _function(
    "dds_read_instance", _int, _entity, _Pointers, _Pointer, _size, ctypes.c_uint32, ctypes.c_uint64
)
_return_loan = _function("dds_return_loan", _int, _entity, _Pointers, _int)
_type_information = _function("dds_builtintopic_get_endpoint_type_info", _int, _Pointer, _Pointers)
_create_descriptor = _function(
    "dds_create_topic_descriptor", _int, ctypes.c_int, _entity, _Pointer, ctypes.c_int64, _Pointers
)
_delete_descriptor = _function("dds_delete_topic_descriptor", None, _Pointer)
_create_topic = _function("dds_create_topic", _entity, _entity, _Pointer, ctypes.c_char_p, _Pointer, _Pointer)
_create_waitset = _function("dds_create_waitset", _entity, _entity)
_attach = _function("dds_waitset_attach", _int, _entity, _entity, ctypes.c_ssize_t)
_wait = _function("dds_waitset_wait", _int, _entity, ctypes.POINTER(ctypes.c_ssize_t), _size, ctypes.c_int64)
_take = _function(
    "dds_takecdr",
    _int,
    _entity,
    _Pointers,
    ctypes.c_uint32,
    ctypes.POINTER(dds_c_t.sample_info),
    ctypes.c_uint32,
)
_sample_size = _function("ddsi_serdata_size", ctypes.c_uint32, _Pointer)
_sample_bytes = _function("ddsi_serdata_to_ser", None, _Pointer, _size, _size, _Pointer)
_sample_free = _function("ddsi_serdata_unref", None, _Pointer)


@dataclass(frozen=True)
class Offer:
    """A writer as it is announced.

    handle : its number in this process
    kind : the name of its type
    identifier : of its complete type, None where it sends none
    qos : the policies that a reader must ask for alike
    """

    handle: int
    topic: str
    kind: str
    identifier: Any = field(compare=False)
    qos: Any = field(compare=False)

    @property
    def group(self) -> tuple[str, str, bytes, str]:
        """Writers of one group are read by one reader."""
        told = b"" if self.identifier is None else bytes(self.identifier.equivalence_hash)
        return self.topic, self.kind, told, self.quality

    @property
    def best_effort(self) -> bool:
        """Whether the writer does not send again what was lost on the way."""
        return Policy.Reliability.BestEffort in self.qos

    @property
    def quality(self) -> str:
        """The policies, as text."""
        return ", ".join(sorted(str(policy).removeprefix("Policy.") for policy in self.qos))


@dataclass(frozen=True)
class Told:
    """The type of an offer: its name and text in IDL, and its description for Cyclone DDS, for one use."""

    name: str
    idl: str
    descriptor: Any


@dataclass(frozen=True)
class Sample:
    """One payload with its encapsulation, its writer, and when that one stamped it [ns], None: not said."""

    writer: int
    data: bytes
    sent: int | None


class Source:
    """A reader of one group of writers."""

    def __init__(self, reader: Any, condition: Any) -> None:
        self._reader = reader
        self._condition = condition
        self._pointers = (_Pointer * MOST_SAMPLES)()
        self._infos = (dds_c_t.sample_info * MOST_SAMPLES)()
        self._buffer = ctypes.create_string_buffer(1 << 16)

    def take(self) -> list[Sample]:
        """Take what has arrived, in the order of the writers' stamps: DDS gives it key by key."""
        found: list[Sample] = []
        for _ in range(MOST_ROUNDS):
            count = self._take_some(found)
            if count < MOST_SAMPLES:
                break
        return sorted(found, key=lambda sample: sample.sent or 0)

    def _take_some(self, found: list[Sample]) -> int:
        """Take at most ``MOST_SAMPLES``; return how many there were, those without a payload among them."""
        count = _take(self._reader._ref, self._pointers, MOST_SAMPLES, self._infos, ANY_STATE)  # noqa: SLF001
        if count < 0:
            raise IdentError(f"samples cannot be taken: {DDSException(count)}")
        for pointer, info in zip(self._pointers[:count], self._infos[:count], strict=True):
            if info.valid_data and pointer is not None:
                sent = int(info.source_timestamp)
                found.append(
                    Sample(info.publication_handle & HANDLE, self._bytes(pointer), sent if sent > 0 else None)
                )
            _sample_free(pointer)
        return int(count)

    def lost(self) -> int:
        """Return how many samples Cyclone DDS counts as lost or turned away.

        It counts none that a best-effort writer lost on the way
        (https://github.com/ros2/demos/issues/642).
        """
        lost = self._reader.get_sample_lost_status().total_count
        return int(lost + self._reader.get_sample_rejected_status().total_count)

    def _bytes(self, pointer: int) -> bytes:
        size = _sample_size(pointer)
        if size > len(self._buffer):
            self._buffer = ctypes.create_string_buffer(2 * size)
        _sample_bytes(pointer, 0, size, self._buffer)
        return ctypes.string_at(self._buffer, size)


class Domain:
    """A participant in a DDS domain.

    Raises
    ------
    UsageError
        If the domain cannot be joined.
    """

    def __init__(self, number: int) -> None:
        try:
            self._participant = DomainParticipant(number)
            self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
            mask = SampleState.NotRead | ViewState.Any | InstanceState.Alive
            self._news = ReadCondition(self._publications, mask)
        except DDSException as error:
            text = f"DDS domain {number} cannot be joined: {error}: check the network and CYCLONEDDS_URI"
            raise UsageError(text) from error
        self._waitset = _create_waitset(self._ref)
        self._sources: list[Source] = []
        _check(_attach(self._waitset, self._news._ref, -1), "wait")  # noqa: SLF001
        self._further: dict[str, list[Any]] = {}

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the domain."""
        for participant in [self._participant, *chain.from_iterable(self._further.values())]:
            participant._delete(participant._ref)  # noqa: SLF001

    @property
    def _ref(self) -> int:
        return int(self._participant._ref)  # noqa: SLF001

    # --- who publishes ----------------------------------------------------------------------------

    def offers(self) -> list[Offer]:
        """Return the writers that were announced since the last call."""
        found = self._publications.read(MOST_SAMPLES, condition=self._news)
        return [_offer(each) for each in found if each.sample_info.valid_data]

    def type_of(self, offer: Offer, patience: float) -> Told:
        """Ask for the definition of a type; this may wait for other participants to answer.

        Parameters
        ----------
        patience : how long to wait for an answer [s]

        Raises
        ------
        UntoldType
            If the writer sends no type information, nobody tells the definition, or it cannot be used.
        """
        if offer.identifier is None:
            raise UntoldType(NO_TYPE)
        wait = int(patience * 1e9)
        with self._information(offer.handle) as information:
            descriptor = _Pointer()
            code = _create_descriptor(_GLOBAL_SCOPE, self._ref, information, wait, ctypes.byref(descriptor))
        if code == DDSException.DDS_RETCODE_TIMEOUT:
            raise UntoldType(f"no participant told the definition of its type within {patience:g} s")
        _check(code, "its type cannot be used", UntoldType)
        try:
            name, idl = type_text(offer.identifier, lambda each: self._type_object(each, wait))
        except UntoldType:
            _delete_descriptor(descriptor)
            raise
        except Exception as error:  # what came from the network may hold anything, and ends no recording
            _delete_descriptor(descriptor)
            raise UntoldType(f"the definition of its type makes no sense ({error!r})") from error
        return Told(name, idl, descriptor)

    @contextlib.contextmanager
    def _information(self, handle: int) -> Iterator[Any]:
        """Give the type information of a writer, as long as the sample that holds it is on loan."""
        samples = (_Pointer * 1)()
        infos = (dds_c_t.sample_info * 1)()
        reader = self._publications._ref  # noqa: SLF001
        count = _read_instance(reader, samples, ctypes.addressof(infos), 1, 1, handle)
        if count < 1:
            raise UntoldType("its writer left before its type was known")
        try:
            information = _Pointer()
            code = _type_information(samples[0], ctypes.byref(information)) if infos[0].valid_data else 0
            _check(code, NO_TYPE, UntoldType)
            if not information.value:
                raise UntoldType(NO_TYPE)
            yield information
        finally:
            _return_loan(reader, samples, count)

    def _type_object(self, identifier: Any, wait: int) -> Any:
        told = _clayer.ddspy_get_typeobj(self._ref, identifier.serialize(use_version_2=True)[4:], wait)
        if isinstance(told, int):
            raise UntoldType(f"the definition of a part of its type is not told: {DDSException(told)}")
        try:
            return TypeObject.deserialize(told, has_header=False, use_version_2=True)
        except Exception as error:  # what came from the network may hold anything
            raise UntoldType(f"the definition of its type cannot be read ({error})") from error

    # --- what they publish ------------------------------------------------------------------------

    def open(self, offer: Offer, told: Told) -> Source:
        """Read what the writers of a group publish from now on, and what they keep for who comes late.

        Raises
        ------
        UntoldType
            If Cyclone DDS cannot read this type, or this kind of offer.
        """
        try:
            reader = self._reader(offer, told)
        finally:
            _delete_descriptor(told.descriptor)
        condition = ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
        source = Source(reader, condition)
        self._sources.append(source)
        _check(_attach(self._waitset, condition._ref, len(self._sources) - 1), "wait")  # noqa: SLF001
        return source

    def _reader(self, offer: Offer, told: Told) -> Any:
        """Make a reader; a topic of the same name and another type needs a participant of its own."""
        number = self._participant.get_domain_id()
        for participant in self._participants(offer.topic, number):
            code = _create_topic(participant._ref, told.descriptor, offer.topic.encode(), None, None)  # noqa: SLF001
            if code != DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
                break
        _check(code, "no topic of its type can be made", UntoldType)
        topic = Topic.__new__(Topic)
        Entity.__init__(topic, code)
        qos = Qos(*offer.qos, Policy.History.KeepAll)
        try:
            return DataReader(participant, topic, qos=qos)
        except DDSException as error:
            raise UntoldType(f"it cannot be read as it is offered ({error})") from error

    def _participants(self, topic: str, number: int) -> Iterator[Any]:
        yield self._participant
        further = self._further.setdefault(topic, [])
        yield from further
        further.append(DomainParticipant(number))
        yield further[-1]

    def wait(self, seconds: float) -> list[Source]:
        """Wait for samples or for news of writers; return the sources that have samples."""
        most = len(self._sources) + 1
        which = (ctypes.c_ssize_t * most)()
        count = _wait(self._waitset, which, most, int(seconds * 1e9))
        _check(count, "wait")
        return [self._sources[number] for number in which[: min(count, most)] if number >= 0]


def _offer(told: Any) -> Offer:
    identifier = told.type_id if told.type_id is not None and told.type_id.discriminator == COMPLETE else None
    qos = tuple(policy for policy in map(_asked, told.qos) if policy is not None)
    handle = told.sample_info.instance_handle & HANDLE
    return Offer(handle, told.topic_name, told.type_name, identifier, qos)


def _asked(policy: Any) -> Any:
    """Return what a reader asks for where a writer offers this policy, None: what it asks for anyway."""
    if policy.__scope__ not in _MATCHED:
        return None
    if policy.__scope__ == "Reliability" and policy != Policy.Reliability.BestEffort:
        return Policy.Reliability.Reliable(100 * _MILLISECOND)
    if policy in {Policy.Durability.Transient, Policy.Durability.Persistent}:
        return Policy.Durability.TransientLocal
    return policy


def _check(code: int, what: str, kind: type[IdentError] = IdentError) -> None:
    if code < 0:
        raise kind(f"{what} ({DDSException(code)})")
