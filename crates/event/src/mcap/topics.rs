//! The topics of a recording that hold events, and the chosen one.

use super::{CDR, EVENT_PACKET};
use std::collections::{BTreeMap, BTreeSet};

/// The same type in ROS 1, whose messages are encoded otherwise.
const EVENT_PACKET_OF_ROS_1: &str = "event_camera_msgs/EventPacket";

/// Maximum number of topics of events: a robot has a few cameras.
const MAX_TOPICS: usize = 256;

/// The topics of events that were seen so far.
#[derive(Debug)]
pub(super) struct EventTopics {
    /// The topic that a person chose.
    asked: Option<String>,
    /// Schemas by number: true for events.
    schemas: BTreeMap<u16, bool>,
    /// Names of topics of events.
    names: BTreeSet<String>,
    /// Channels of the topic that is read. A recording may have several of one topic.
    chosen: BTreeSet<u16>,
}

impl EventTopics {
    pub(super) fn new(asked: Option<&str>) -> Self {
        Self {
            asked: asked.map(str::to_owned),
            schemas: BTreeMap::new(),
            names: BTreeSet::new(),
            chosen: BTreeSet::new(),
        }
    }

    /// Takes a schema.
    pub(super) fn add_schema(&mut self, id: u16, name: &str) {
        self.schemas.insert(id, name == EVENT_PACKET || name == EVENT_PACKET_OF_ROS_1);
    }

    /// Takes a channel. The error says why its topic cannot be read.
    pub(super) fn add_channel(
        &mut self,
        id: u16,
        schema: u16,
        topic: String,
        encoding: &str,
    ) -> Result<(), String> {
        match self.schemas.get(&schema) {
            Some(true) => {}
            // A channel without a schema has the number 0.
            None if schema != 0 => {
                return Err(format!("channel {id} has the schema {schema}, which is absent before it"));
            }
            _ => return Ok(()),
        }
        let is_asked = self.asked.as_ref().is_none_or(|asked| *asked == topic);
        if is_asked && encoding != CDR {
            return Err(format!("messages of `{topic}` are encoded as `{encoding}`, wanted `{CDR}`"));
        }
        self.names.insert(topic);
        if self.names.len() > MAX_TOPICS {
            return Err(format!("more than {MAX_TOPICS} topics of events"));
        }
        if self.asked.is_none() && self.names.len() > 1 {
            return Err(format!("events on the topics {}: choose one with --topic", self.listed()));
        }
        if is_asked {
            self.chosen.insert(id);
        }
        Ok(())
    }

    /// Returns true if messages of this channel are read.
    pub(super) fn is_chosen(&self, channel: u16) -> bool {
        self.chosen.contains(&channel)
    }

    /// The reason why a whole recording had no message of events.
    pub(super) fn explain_absence(&self) -> String {
        match &self.asked {
            _ if self.names.is_empty() => format!("no topic of the type {EVENT_PACKET}"),
            Some(asked) if self.chosen.is_empty() => {
                format!("no events on the topic `{asked}`; they are on {}", self.listed())
            }
            _ => format!("{} has no message", self.listed()),
        }
    }

    fn listed(&self) -> String {
        let names: Vec<String> = self.names.iter().map(|name| format!("`{name}`")).collect();
        names.join(", ")
    }
}
