"""Messages for other programs are made once somebody listens, and then always."""

from types import SimpleNamespace

import pytest
from std_msgs.msg import String

from hmap.supervision.latched import LatchedOnDemand


class Topic:
    """Stands in for a node and its publisher; ``sent`` are the messages, ``made`` those that were made."""

    group = None

    def __init__(self):
        self.sent, self.made, self.listening, self.events = [], [], 0, None

    def create_publisher(self, message_type, topic, quality, callback_group, event_callbacks):
        self.events = event_callbacks
        return self

    def publish(self, message):
        self.sent.append(message)

    def get_subscription_count(self):
        return self.listening

    def listen(self, count: int):
        self.listening = count
        self.events.matched(SimpleNamespace(current_count=count))

    def make(self, text: str):
        return lambda: self.made.append(text) or String(data=text)


@pytest.fixture
def topic():
    return Topic()


@pytest.fixture
def latched(topic):
    return LatchedOnDemand(topic, String, "drawn")


def test_without_a_subscriber_nothing_is_made(topic, latched):
    latched.publish(topic.make("first"))
    assert topic.made == topic.sent == []


def test_a_late_subscriber_gets_the_newest_message_once(topic, latched):
    for text in ("first", "second"):
        latched.publish(topic.make(text))
    topic.listen(1)
    topic.listen(2)
    assert [message.data for message in topic.sent] == topic.made == ["second"]


def test_after_the_first_subscriber_each_message_is_sent_so_that_no_late_one_gets_an_old_one(topic, latched):
    topic.listen(1)
    topic.listen(0)
    for text in ("first", "second"):
        latched.publish(topic.make(text))
    assert [message.data for message in topic.sent] == ["first", "second"]


def test_a_subscriber_of_which_no_event_has_come_yet_is_counted(topic, latched):
    topic.listening = 1
    latched.publish(topic.make("first"))
    assert topic.made == ["first"]
