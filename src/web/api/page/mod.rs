//! `/api/v1/docs`: the OpenAPI document as a page, for people; made on the server, without scripts.

mod kind;
mod sample;

use std::sync::LazyLock;

use askama::Template;
use axum::response::{Html, IntoResponse, Response};
use serde_json::Value;

use self::{kind::Kind, sample::sample};
use super::{NoQuery, document::DOCUMENT, extract::Query};
use crate::web::{ApiError, Error, assets};

/// The page is the same for everybody, so it is written once.
static PAGE: LazyLock<Result<String, String>> = LazyLock::new(|| {
    let document = serde_json::from_str(&DOCUMENT).map_err(|error| error.to_string())?;
    let page = DocsPage::new(&document);
    page.render().map_err(|error| error.to_string())
});

/// This API as a page for people.
#[utoipa::path(
    get, path = "/docs", tag = "description",
    responses((status = 200, description = "The page", content((String = "text/html; charset=utf-8")))),
    security(()),
)]
pub(in crate::web::api) async fn docs(
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    match &*PAGE {
        Ok(page) => Ok(Html(page.as_str()).into_response()),
        Err(error) => Err(Error::Internal(anyhow::anyhow!("{error}")).into()),
    }
}

#[derive(Template)]
#[template(path = "api.html")]
struct DocsPage {
    version: String,
    description: Words,
    security: Words,
    groups: Vec<Group>,
    schemas: Vec<SchemaEntry>,
}

struct Group {
    name: String,
    description: Words,
    operations: Vec<OperationEntry>,
}

struct OperationEntry {
    id: String,
    method: String,
    path: String,
    summary: Words,
    description: Words,
    /// The scope that a token needs; empty where none is needed.
    scope: String,
    parameters: Vec<Field>,
    body: Option<Content>,
    responses: Vec<ResponseEntry>,
    curl: String,
}

struct ResponseEntry {
    status: String,
    description: Words,
    content: Option<Content>,
}

struct Content {
    media_type: String,
    kind: Kind,
    /// JSON made of the schema; nothing for other forms, and for errors, which all look the same.
    sample: Option<String>,
}

/// A parameter or a property.
struct Field {
    name: String,
    /// Where a parameter stands; empty for a property.
    place: String,
    kind: Kind,
    is_required: bool,
    description: Words,
}

struct SchemaEntry {
    name: String,
    description: Words,
    kind: Kind,
    fields: Vec<Field>,
}

impl DocsPage {
    fn new(document: &Value) -> Self {
        let operations: Vec<(&str, OperationEntry)> = entries(&document["paths"])
            .flat_map(|(path, item)| {
                let methods = entries(item);
                methods.map(move |(method, operation)| (path, method, operation))
            })
            .map(|(path, method, operation)| {
                let tag = text(&operation["tags"][0]);
                (tag, OperationEntry::new(document, method, path, operation))
            })
            .collect();
        let mut groups: Vec<Group> = list(&document["tags"])
            .map(|tag| Group {
                name: owned(&tag["name"]),
                description: words(&tag["description"]),
                operations: Vec::new(),
            })
            .collect();
        for (tag, operation) in operations {
            if let Some(group) = groups.iter_mut().find(|group| group.name == tag) {
                group.operations.push(operation);
            }
        }
        Self {
            version: owned(&document["info"]["version"]),
            description: words(&document["info"]["description"]),
            security: words(&document["components"]["securitySchemes"]["token"]["description"]),
            groups,
            schemas: entries(&document["components"]["schemas"])
                .map(|(name, schema)| SchemaEntry::new(name, schema))
                .collect(),
        }
    }
}

impl OperationEntry {
    fn new(document: &Value, method: &str, path: &str, operation: &Value) -> Self {
        let body = content(document, &operation["requestBody"]["content"]);
        let method = method.to_uppercase();
        let example = path.replace("{study}", "driving").replace("{fit}", "17");
        let required = list(&operation["parameters"])
            .filter(|parameter| parameter["in"] == "query" && parameter["required"] == true)
            .map(|parameter| format!("{}=1", text(&parameter["name"])));
        let query: Vec<String> = required.collect();
        let query = if query.is_empty() {
            String::new()
        } else {
            format!("?{}", query.join("&"))
        };
        let sent = body
            .as_ref()
            .and_then(|_| serde_json::to_string(&sample(document, request_schema(operation))).ok())
            .map(|body| format!(" \\\n  -H 'content-type: application/json' \\\n  -d '{body}'"));
        let option = if path.ends_with("/events") {
            "-N"
        } else {
            "-s"
        };
        Self {
            id: format!(
                "{}-{}",
                method.to_lowercase(),
                path.replace(['/', '{', '}', '.'], "-")
            ),
            curl: format!(
                "curl {option} \"http://127.0.0.1:8080{example}{query}\"{}",
                sent.unwrap_or_default()
            ),
            method,
            path: path.to_owned(),
            summary: words(&operation["summary"]),
            description: words(&operation["description"]),
            scope: list(&operation["security"])
                .find_map(|scheme| scheme["token"][0].as_str())
                .unwrap_or_default()
                .to_owned(),
            parameters: list(&operation["parameters"])
                .map(|parameter| Field {
                    name: owned(&parameter["name"]),
                    place: owned(&parameter["in"]),
                    kind: Kind::new(&parameter["schema"]),
                    is_required: parameter["required"] == true,
                    description: words(&parameter["description"]),
                })
                .collect(),
            body,
            responses: entries(&operation["responses"])
                .map(|(status, response)| {
                    let response = resolved(document, response);
                    ResponseEntry {
                        status: status.to_owned(),
                        description: words(&response["description"]),
                        content: content(document, &response["content"]),
                    }
                })
                .collect(),
        }
    }
}

impl SchemaEntry {
    fn new(name: &str, schema: &Value) -> Self {
        Self {
            name: name.to_owned(),
            description: words(&schema["description"]),
            kind: Kind::new(schema),
            fields: fields(schema),
        }
    }
}

/// The properties of an object, those of the parts that it is put together from included.
fn fields(schema: &Value) -> Vec<Field> {
    let parts = list(&schema["allOf"]).flat_map(fields);
    let own = entries(&schema["properties"]).map(|(name, property)| Field {
        name: name.to_owned(),
        place: String::new(),
        kind: Kind::new(property),
        is_required: list(&schema["required"]).any(|required| required == name),
        description: words(&property["description"]),
    });
    own.chain(parts).collect()
}

fn request_schema(operation: &Value) -> &Value {
    &operation["requestBody"]["content"]["application/json"]["schema"]
}

fn content(document: &Value, content: &Value) -> Option<Content> {
    let (media_type, content) = entries(content).next()?;
    let schema = &content["schema"];
    let is_shown = media_type == "application/json" && *schema != Value::Bool(true);
    Some(Content {
        media_type: media_type.to_owned(),
        kind: Kind::new(schema),
        sample: is_shown
            .then(|| serde_json::to_string_pretty(&sample(document, schema)).ok())
            .flatten(),
    })
}

/// What a reference leads to.
fn resolved<'a>(document: &'a Value, item: &'a Value) -> &'a Value {
    item["$ref"]
        .as_str()
        .and_then(|path| document.pointer(path.strip_prefix('#')?))
        .unwrap_or(item)
}

fn entries(object: &Value) -> impl Iterator<Item = (&str, &Value)> {
    object
        .as_object()
        .into_iter()
        .flatten()
        .map(|(name, value)| (name.as_str(), value))
}

fn list(array: &Value) -> impl Iterator<Item = &Value> {
    array.as_array().into_iter().flatten()
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

/// A text in pieces, every second one of which is code.
type Words = Vec<String>;

fn words(value: &Value) -> Words {
    let pieces = text(value).split('`').map(str::to_owned);
    pieces.collect()
}

fn owned(value: &Value) -> String {
    text(value).to_owned()
}
