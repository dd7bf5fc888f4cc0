//! The rules of the hosts' protocol, each with a conversation, byte by byte.

use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::{Conversation, machine};

/// Bytes that a host sends in one go, and the lines that the printer answers.
struct Exchange {
    said: Vec<u8>,
    heard: Vec<String>,
}

/// A rule's text and conversation.
struct Rule {
    text: String,
    exchanges: Vec<Exchange>,
}

fn rules() -> Vec<Rule> {
    let mut rules: Vec<Rule> = Vec::new();
    for line in include_str!("../../data/protocol.transcript").lines() {
        if let Some(text) = line.strip_prefix("== ") {
            rules.push(Rule { text: text.to_owned(), exchanges: Vec::new() });
        } else if let Some(said) = line.strip_prefix('>') {
            let said = said.strip_prefix(' ').unwrap_or(said).replace("\\r", "\r").replace("\\t", "\t");
            let exchanges = &mut rules.last_mut().unwrap().exchanges;
            exchanges.push(Exchange { said: format!("{said}\n").into_bytes(), heard: Vec::new() });
        } else if let Some(heard) = line.strip_prefix("< ") {
            rules.last_mut().unwrap().exchanges.last_mut().unwrap().heard.push(heard.to_owned());
        } else {
            assert!(line.is_empty() || line.starts_with('#'), "{line:?} is no line of a transcript");
        }
    }
    rules
}

#[test]
fn every_rule_of_the_protocol_is_kept() {
    let rules = rules();
    assert!(rules.len() > 20);
    for Rule { text, exchanges } in rules {
        let machine = machine(&profile("cartesian"));
        let mut conversation = Conversation::new(&machine);
        for Exchange { said, heard } in exchanges {
            let replies = conversation.say_bytes(&said);
            let replies: Vec<&str> = replies.iter().flat_map(|reply| reply.lines()).collect();
            assert_eq!(replies, heard, "{text}: {:?}", String::from_utf8_lossy(&said));
        }
    }
}
